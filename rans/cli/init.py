"""``rans init``: a commented TOML file of your own spacecraft, to write the numbers of a data sheet into."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from rans.api.drafting import AUTHORITY_COLUMNS, check_free, check_target, init_spacecraft
from rans.base.errors import ConfigError, is_installed
from rans.base.table import Table
from rans.base.terminal import Terminal
from rans.cli.door import Options, command_of

if TYPE_CHECKING:
    from rans.api.drafting import Draft


@command_of(
    init_spacecraft,
    without=("name",),
    base=Annotated[str | None, arg(name="from", metavar="SPACECRAFT")],
    dimension=Annotated[int | None, arg(metavar="2|3")],
)
class Init(Options):
    """Write the TOML file of a new spacecraft, draw its thrusters, and print its control authority.

    The file begins as that of another spacecraft: write your numbers into it. The authority is the largest force
    along each axis, and the largest torque about it, while all others are zero.
    """

    group = "Describe"
    guide = "docs/spacecraft.md"
    examples = (
        "rans init mine.toml",
        "rans init mine.toml --from atmos",
        "rans init mine.toml --from robot.urdf --dimension 3",
    )
    following = ("rans list {file}",)

    file: Annotated[Path, Positional, arg(metavar="FILE.toml")]
    """File to write."""

    def run(self) -> int:
        """Check, write and draw; the exit code is 0."""
        if not self.file.name:
            raise ConfigError(
                f"name the file to write, such as mine.toml, got {str(self.file)!r}, which is a folder."
            )
        picture = self.file.with_suffix(".svg") if is_installed("matplotlib") else None
        check_target(self.file)
        if picture is not None:
            check_free(picture)
        draft = init_spacecraft(self.file.stem, base=self.base, dimension=self.dimension)
        draft.write(self.file, picture)
        self._show(draft, picture)
        return 0

    def _show(self, draft: Draft, picture: Path | None) -> None:
        """Print control authority, recoverable faults, whose numbers a template has, and the next commands."""
        from rans.base.pretrained import FOR_ANY_CRAFT
        from rans.cli.details import prospects
        from rans.cli.next_commands import training
        from rans.policy.backbones import any_craft

        # Control authority, whether it settles, and thrusters without which it still does.
        craft = draft.spacecraft
        console = Terminal()
        console.table(
            Table(
                AUTHORITY_COLUMNS,
                draft.authority_rows(),
                f"{craft.name}: largest force and torque, with every other one at zero",
            )
        )
        steerable = craft.is_steerable
        for sentence in prospects(craft, str(self.file)) if steerable else any_craft().slips(craft):
            console.say(sentence)
        console.say(f"Written: {self.file}" + (f" and {picture}" if picture else ""))
        console.say("Its numbers are those of what it begins from: write your own into it.")
        # What cannot be steered is not worth a flight or a training.
        file = shlex.quote(str(self.file))
        agent = FOR_ANY_CRAFT[craft.dimension]
        flights = [
            f"rans compare {file}",
            f"rans view {agent}@{file}",
            *([f"rans validate {file} --quick"] if is_installed("pydrake") else []),
        ]
        worth = [*flights, *training(craft, str(self.file))] if steerable else []
        console.suggest(*worth, f"rans list {file}")
