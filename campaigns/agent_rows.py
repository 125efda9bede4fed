"""The rows of docs/agents.md, of agent_rows.toml: task, protocol, what is asked, and what the original reaches."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rans.evaluation.fly.protocols import ProtocolName
from rans.files import read_text
from rans.structure import read_toml, structure


@dataclass(frozen=True)
class Goal:
    """Figures that are asked of an agent, by the names of their metrics."""

    metrics: tuple[str, ...]
    unit: str
    targets: tuple[float, ...] = ()
    at_least: bool = False
    """Whether more is better."""
    original: str = "–"  # noqa: RUF001
    """The original system's best published agent (notebook eval_multi_models of its version 1.0)."""
    slack: float = 0.0
    """The target is that of the time-optimal trajectories from the same starts, less this."""


@dataclass(frozen=True)
class Row:
    """An agent under a protocol."""

    title: str
    agent: str
    """Its runs are called so, with -seed0 and so on behind it."""
    goals: tuple[Goal, ...]
    protocol: ProtocolName = "own"
    distance: tuple[float, float] | None = None
    """Of the starts, m, where it is not the protocol's."""
    path: str = ""
    """To follow, for a velocity tracker; see `rans_assurance.follow.paths.find_path`."""

    @property
    def command(self) -> str:
        """Repeats the evaluation of the agent that comes with RANS."""
        if self.path:
            return f"rans follow pretrained:{self.agent} {self.path}"
        protocol = "" if self.protocol == "own" else f" --protocol {self.protocol}"
        return f"rans evaluate pretrained:{self.agent}{protocol}"


ROWS = tuple(
    structure(row, Row, "a row of agent_rows.toml")
    for row in read_toml(read_text(Path(__file__).with_suffix(".toml")))["row"]
)
"""In the order of the table."""
