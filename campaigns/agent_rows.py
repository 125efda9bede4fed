"""The rows of docs/agents.md: task, protocol, what is asked, and what the original system's agents reach."""

from __future__ import annotations

from dataclasses import dataclass

from rans.evaluation.fly.protocols import ProtocolName


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


LEAST_TIME = 5.33
"""Mean certified least time to arrive at rest, s (docs/certificate.md): of another event than settling."""
LEAST_IMPULSE = 2.03
"""Mean certified least impulse for 20 s, N s (docs/certificate.md): episodes last 25 s."""
CHATTER = 2.5
"""More than this is chatter, %: one of eight valves, one control period in five."""

_PT = ("PT5", "PT2", "PT1")
_OT = ("OT5", "OT2", "OT1")
_RMS = "cross-track RMS"
_TRACKING = (
    Goal(("velocity error after 5 s",), "m/s", (0.02,), original="no figures"),
    Goal(("spin error after 5 s",), "rad/s", (0.02,), original="no figures"),
)

ROWS = (
    Row(
        "3DoF go to pose, original",
        "go-to-pose-2d-shared",
        (
            Goal(_PT, "%", (60.3, 35.1, 10.6), at_least=True, original="60.3 / 35.1 / 10.6 %"),
            Goal(_PT, "%", at_least=True, slack=2.0),
            Goal(_OT, "%", (96.5, 96.0, 95.0), at_least=True, original="96.7 / 92 / 80.5 %"),
            Goal(("reach 1 cm",), "%", (100.0,), at_least=True, original="87.9 %"),
            Goal(("duty",), "%", (8.0,), original="42.7 %, a thriftier agent 34.4 %"),
        ),
        "original",
    ),
    Row(
        "3DoF go to position, original",
        "go-to-position-2d-shared",
        (
            Goal(_PT, "%", (82.0, 81.0, 80.0), at_least=True, original="66.2 / 59.2 / 32.9 %"),
            Goal(("duty",), "%", (8.0,), original="20.3 %"),
        ),
        "original",
    ),
    Row(
        "3DoF go to pose, paper",
        "go-to-pose-2d",
        (
            Goal(_PT, "%", (88.0, 87.0, 85.0), at_least=True),
            Goal(_PT, "%", at_least=True, slack=2.0),
            Goal(("duty",), "%", (8.0,)),
        ),
        "paper",
    ),
    Row(
        "3DoF go to pose, fast variant, 25 s",
        "go-to-pose-2d-fast",
        (
            Goal(("settled",), "%", (100.0,), at_least=True),
            Goal(("settling time",), "s", (1.10 * LEAST_TIME,)),
        ),
    ),
    Row(
        "3DoF go to pose, thrifty variant, 25 s",
        "go-to-pose-2d-thrifty",
        (
            Goal(("settled",), "%", (100.0,), at_least=True),
            Goal(("impulse",), "N s", (2.0 * LEAST_IMPULSE,)),
            Goal(("duty at rest",), "%", (CHATTER,)),
        ),
    ),
    Row(
        "6DoF go to pose, 3 to 4 m, 25 s",
        "go-to-pose-3d",
        (
            Goal(
                ("solved to 5 cm 3 deg",),
                "%",
                (99.5,),
                at_least=True,
                original="overshoot and spin, no figures",
            ),
            Goal(("position error",), "cm", (1.5,)),
            Goal(("attitude error",), "deg", (1.0,)),
        ),
        distance=(3.0, 4.0),
    ),
    Row(
        "6DoF go to position, 1 to 5 m, 25 s",
        "go-to-position-3d",
        (
            Goal(("solved to 5 cm",), "%", (99.5,), at_least=True, original='"acceptable"'),
            Goal(("position error",), "cm", (1.5,)),
            Goal(("spin at rest",), "rad/s", (0.1,)),
        ),
        distance=(1.0, 5.0),
    ),
    Row("3DoF track velocity, up to 0.75 m/s", "track-velocity-2d", _TRACKING),
    Row("6DoF track velocity, up to 0.75 m/s", "track-velocity-3d", _TRACKING),
    Row(
        "3DoF track twist, up to 0.5 m/s and 0.5 rad/s, shared thrust",
        "track-twist-2d-shared",
        _TRACKING,
    ),
    Row(
        "6DoF track twist, up to 0.5 m/s and 0.5 rad/s, shared thrust",
        "track-twist-3d-shared",
        _TRACKING,
    ),
    *(
        Row(
            f"3DoF follow the {path} at 0.25 m/s",
            "track-velocity-2d",
            (Goal((_RMS,), "cm", (bound,), original="plots only"),),
            path=path,
        )
        for path, bound in (("circle", 5.0), ("spiral", 5.0), ("square", 8.0))
    ),
)
"""In the order of the table."""
