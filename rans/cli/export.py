"""``rans export``: an agent as files for other software."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, get_args

from tyro.conf import Positional, arg

from rans.cli import check_count
from rans.deploy.forms import FORMATS, Form, forms
from rans.errors import ConfigError, brief, one_of, require
from rans.files import read_json
from rans.pretrained import pretrained_folder, pretrained_names
from rans.terminal import Terminal, doing

_PACKAGES = {"onnx": "onnx", "sb3": "stable_baselines3"}
"""Modules that formats need beside the core."""


@dataclass(frozen=True)
class Export:
    """Export an agent for other software, with an interface contract, test vectors and a model card.

    rans is a folder that works as a run folder, without the critic. sb3 is such a folder whose policy.zip
    stable_baselines3.PPO.load opens, to continue the training there. onnx is one file for any ONNX runtime. numpy
    is a Python file and its tables. c is a header and a source in C99, without allocation or dependencies; it
    is compiled and checked if there is a compiler. fmu is a unit of FMI 2.0 for co-simulation,
    as Simulink and Dymola read it.
    """

    group = "Deploy"
    guide = "docs/export.md"
    examples = (
        "rans export runs/first --output my-agent --format onnx",
        "rans export pretrained:go-to-pose-2d --output my-agent --format numpy",
    )

    choices: ClassVar[dict[str, Callable[[], tuple[str, ...]]]] = {"format": forms}

    run_folder: Annotated[str, Positional, arg(metavar="RUN")]
    """Run folder of the agent, or the name of one that comes with RANS; any-craft-2d@mine.toml is exported for that
    craft. onnx:FILE:TASK-2d@SPACECRAFT is a network of another library, exported as it is (c, numpy or onnx)."""
    output: Path | None = None
    """Folder to write, whose name becomes the agent's name; by default runs/exports/ and the name of the agent."""
    format: Annotated[str, arg(metavar="FORM")] = "rans"
    """Format of the agent: rans, sb3, onnx, numpy, c or fmu. None has the safety filter, which needs RANS: the
    contract names it, and `rans fly` on the folder applies it (docs/missions/guard.md)."""
    episodes: int = 1024
    """Number of evaluation flights for the model card. A quarter as many fly at each latency, mass and sensor noise
    around the conditions of the training, from which the contract states the intervals in which the agent solves
    its task; with fewer than 256 episodes it states none."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return (shlex.join(["rans", "view", self.run_folder]),)

    def run(self) -> int:
        """Write the export and print its files."""
        from rans.deploy.export import EXPORTERS, write_export
        from rans.deploy.margins import margin_lines
        from rans.evaluation.fly.contestant_name import ContestantName

        check_count("--episodes", self.episodes)
        one_of("--format", self.format, forms())
        if self.format not in get_args(Form):
            FORMATS.check_installed(self.format)
        name = ContestantName.parse(self.run_folder)
        is_foreign = name.kind == "policy"
        folder = name.policy_file if is_foreign else name.folder
        if folder is None and name.name.startswith("onnx:"):
            raise ConfigError(f"there is no file {name.name.removeprefix('onnx:')}.")
        if folder is None:
            raise ConfigError(
                f"{brief(self.run_folder)} is no ONNX file, and an export needs the operations of one. Let its own "
                "library write ONNX, as examples/trainers do by --save FILE, and export onnx:FILE:TASK-2d."
            )
        if part := name.part:
            raise ConfigError(
                "an agent is exported as a whole, with its trade-off and all its tasks as observations: name "
                f"it without #{part}."
            )
        if self.format == "rans" and not is_foreign and _comes_with_rans(folder):
            raise ConfigError(f"{folder.name} comes with RANS in this format already, in {folder}.")
        # Of 64 flights, 62 that hold show a probability above 0.9 (one-sided, 95 %); fewer show little.
        margins = self.episodes // 4 if self.episodes >= 256 else 0
        # Before minutes of flights.
        write_policy = EXPORTERS[name.kind] if is_foreign else None
        if self.format in _PACKAGES:
            require(_PACKAGES[self.format])
        # The folder of an agent for any craft is named after its craft too.
        label = (
            name.output_folder.name
            if name.craft or name.adapts
            else folder.stem
            if is_foreign
            else folder.name
        )
        output = self.output or Path("runs/exports") / label
        with doing(f"flying {label} for its contract and its card, and writing {output}"):
            if write_policy is not None:
                card = write_policy(name.text, output, self.format, self.episodes, margins=margins)
            else:
                card = write_export(folder, output, self.format, self.episodes, margins=margins)
        size = sum(file.stat().st_size for file in output.iterdir() if file.is_file())
        Terminal().say(f"{output} has the agent, its contract and its card, {size / 1000:.0f} kB.")
        stated = read_json(output / "contract.json")["conditions"]["margins"]
        for line in [] if stated is None else margin_lines(stated, is_foreign):
            Terminal().say(line)
        if self.format == "numpy":
            Terminal().suggest(f"cd {shlex.quote(str(output))} && python agent.py")
        elif self.format == "onnx":
            Terminal().suggest(shlex.join(["rans", "evaluate", str(output)]))
        if self.format == "c":
            from rans.deploy.c_file import compiled_check

            Terminal().say(compiled_check(output))
        if card["episodes"] != self.episodes:
            Terminal().say(f"The card keeps its metrics from {card['episodes']:,} flights.")
        return 0


def _comes_with_rans(folder: Path) -> bool:
    """Whether a folder is that of a pretrained agent."""
    return folder.name in pretrained_names() and folder == pretrained_folder(folder.name)
