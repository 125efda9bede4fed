"""``rans init``: a commented TOML file of your own spacecraft, to write the numbers of a data sheet into."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, UseAppendAction, arg

from rans.api.drafting import AUTHORITY_COLUMNS, check_free, check_target, init_spacecraft
from rans.cli.door import Options, command_of
from rans.errors import ConfigError, brief, is_installed, meant
from rans.model.spacecraft_draft import numbers_of_text
from rans.model.spacecraft_file import USUAL
from rans.table import Table
from rans.terminal import Terminal

if TYPE_CHECKING:
    from rans.api.drafting import Draft

KINDS: dict[str, type] = {
    **dict.fromkeys(("dimension", "counts"), int),
    **dict.fromkeys(("mass", "least", "most", "radius"), float),
    **dict.fromkeys(("name", "actuators", "thrust_sharing"), str),
    **dict.fromkeys(("inertia", "size", "centre_of_mass"), list),
}
"""Kinds of the values of --set, by their keys."""


@command_of(
    init_spacecraft,
    without=("name", *KINDS),
    base=Annotated[str | None, arg(name="from", metavar="SPACECRAFT")],
    thrusters=Annotated[
        UseAppendAction[tuple[str, ...]], arg(name="thruster", metavar="POSITION;DIRECTION;FORCE")
    ],
    wheels=Annotated[
        UseAppendAction[tuple[str, ...]], arg(name="wheel", metavar="AXIS;TORQUE;MOMENTUM;INERTIA")
    ],
)
class Init(Options):
    """Write the TOML file of a new spacecraft, draw its thrusters, and print its control authority.

    Without --from and --thruster it is that of floating-platform, with --set dimension=3 of free-flyer: write your
    numbers into it. The authority is the largest force along each axis, and the largest torque about it, while all
    others are zero. --thruster and --wheel are repeated for each.
    """

    group = "Check"
    guide = "docs/spacecraft.md"
    examples = (
        "rans init mine.toml",
        "rans init mine.toml --from atmos --set mass=16",
        'rans init mine.toml --set dimension=2 --set mass=12 --set size=0.4,0.4 --thruster "-0.2,0.1;1,0;1.5"',
    )

    file: Annotated[Path, Positional, arg(metavar="FILE.toml")]
    """File to write."""
    set: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KEY=VALUE")] = ()
    """A value of the data sheet, as in `--set mass=12` or `--set size=0.4,0.4`; may be repeated. Keys: name,
    dimension (2: the plane, 3: space), mass (kg), inertia (kg m^2, about the centre of mass) or size (sides of a
    uniform box, m), centre_of_mass and radius (m), actuators (on-off, pulsed or throttle), their counts, least and
    most, and thrust_sharing (none, or split: the open thrusters share the supply of one)."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return (f"rans list {shlex.quote(str(self.file))}",)

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
        values = self._given()
        base = self.base
        if base is None and not self.thrusters:
            base = USUAL.get(values.get("dimension", 2))
        name = values.pop("name", self.file.stem)
        draft = init_spacecraft(
            name, base=base, thrusters=self.thrusters, wheels=self.wheels, **values
        )
        draft.write(self.file, picture)
        self._show(draft, picture, base if base != self.base else "")
        return 0

    def _given(self) -> dict[str, Any]:
        """Values of --set by their keys, of the kinds of `KINDS`; a wrong one is refused (`ConfigError`)."""
        values: dict[str, Any] = {}
        for change in self.set:
            key, _, text = change.partition("=")
            if key not in KINDS or key in values or not text:
                raise ConfigError(
                    f"--set takes KEY=VALUE once for each of {', '.join(KINDS)}, got {brief(change)}"
                    f"{meant(key, KINDS)}."
                )
            kind = KINDS[key]
            if kind is list:
                values[key] = numbers_of_text(text, key, (1, 3) if key == "inertia" else (2, 3))
                continue
            try:
                values[key] = kind(text)
            except ValueError:
                raise ConfigError(
                    f"--set {key} takes a {'whole ' * (kind is int)}number, got {brief(text)}."
                ) from None
        return values

    def _show(self, draft: Draft, picture: Path | None, template: str | None) -> None:
        """Print control authority, recoverable faults, whose numbers a template has, and the next commands."""
        from rans.cli.details import prospects
        from rans.cli.next_commands import training
        from rans.model.spacecraft import is_steerable
        from rans.policy.prospects import slips
        from rans.pretrained import FOR_ANY_CRAFT

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
        steerable = is_steerable(craft)
        for sentence in prospects(craft) if steerable else slips(craft):
            console.say(sentence)
        console.say(f"Written: {self.file}" + (f" and {picture}" if picture else ""))
        if template:
            console.say(
                f"What you did not give is that of {template}: write your own numbers into it."
            )
        file = shlex.quote(str(self.file))
        agent = FOR_ANY_CRAFT[craft.dimension]
        console.suggest(
            *([f"rans compare {file}", f"rans view {agent}@{file}"] if steerable else []),
            f"rans list {file}",
            # What cannot be steered is not worth a training.
            *([f"rans validate {file} --quick"] if steerable else []),
            *(training(craft, str(self.file)) if steerable else []),
        )
