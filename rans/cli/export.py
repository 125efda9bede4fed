"""``rans export``: an agent to share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from rans.cli import check_count
from rans.errors import ConfigError
from rans.pretrained import pretrained_folder


@dataclass(frozen=True)
class Export:
    """Copy an agent without what only training needs, with a card that says what it is worth.

    The folder serves wherever a run folder does, and stable_baselines3.PPO.load opens its policy.zip.
    """

    run_folder: Annotated[Path, Positional, arg(metavar="RUN")]
    """Run folder of the agent."""
    output: Path
    """Folder to write; its name is the agent's."""
    episodes: int = 1024
    """Flights behind the card's figures."""

    def run(self) -> int:
        """Print what was written."""
        from rans.deploy.export import export

        check_count("--episodes", self.episodes)
        kind, _, name = str(self.run_folder).partition(":")
        if kind == "pretrained":
            raise ConfigError(f"{name} comes with RANS as an export writes it, in {pretrained_folder(name)}.")
        export(self.run_folder, self.output, self.episodes)
        size = sum(file.stat().st_size for file in self.output.iterdir() if file.is_file())
        print(f"{self.output} holds the agent and its card, {size / 1000:.0f} kB.")
        return 0
