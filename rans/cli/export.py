"""``rans export``: an agent to share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from rans.cli import check_count
from rans.errors import ConfigError
from rans.pretrained import pretrained_folder

Form = Literal["sb3", "onnx", "numpy"]


@dataclass(frozen=True)
class Export:
    """Write an agent to hand on: with its contract, pairs to check, and a card that says what it is worth.

    "sb3" is a folder that serves wherever a run folder does, whose policy.zip stable_baselines3.PPO.load
    opens too. "onnx" is one file for any runtime; "numpy" a Python file and its tables, for NumPy only.
    """

    run_folder: Annotated[str, Positional, arg(metavar="RUN")]
    """Run folder of the agent, or pretrained:NAME."""
    output: Path
    """Folder to write; its name is the agent's."""
    format: Form = "sb3"
    """What to write the agent as."""
    episodes: int = 1024
    """Flights behind the card's figures."""
    trust: bool = False
    """Run the module of a task that a run folder names as MODULE:NAME; only if you know its author."""

    def run(self) -> int:
        """Print what was written."""
        from rans.deploy.export import export

        check_count("--episodes", self.episodes)
        kind, _, name = self.run_folder.partition(":")
        pretrained = kind == "pretrained"
        if pretrained and self.format == "sb3":
            raise ConfigError(f"{name} comes with RANS as an export writes it, in {pretrained_folder(name)}.")
        export(pretrained_folder(name) if pretrained else Path(self.run_folder), self.output, self.format,
               self.episodes)
        size = sum(file.stat().st_size for file in self.output.iterdir() if file.is_file())
        print(f"{self.output} holds the agent, its contract and its card, {size / 1000:.0f} kB.")
        return 0
