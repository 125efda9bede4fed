"""What a trapping set's proof takes an agent for, compared with the agent as RANS flies it.

Prover and checker have their own formulas for network and craft. Both begin here: an architecture with any field
that they do not compute is refused, and the formulas are compared with a flight of one control period by the run's
own task, network, craft and timing.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from rans.extend import (
    Agent,
    Architecture,
    ConfigError,
    Heading,
    LoadedRun,
    Network,
    PlanarState,
    RansError,
    Scenario,
    Vec2,
    brief,
    fly,
    layout,
    load_policy,
)
from rans.policy.heads import OnOff
from rans.tasks.tracking import TrackVelocity
from rans_proof.trap_certificate import FILES, read_certificate

LARGEST_GAP = 1e-4
"""Difference of log-odds from the flown network in double precision that is refused."""
LARGEST_ROUNDING = 5e-4
"""Difference from the flown network in single precision: half of the log-odds that count as undecided."""
_LARGEST_STEP = 1e-6
"""Difference of a velocity (m/s) or spin (rad/s) after a period, relative to one; engine and checker are exact."""
_STATES = 1000
_FREE = {
    "thrusters": "the craft's, compared with it",
    "layers": "sizes of the tensors, which the reader compares",
    "layout": "compared with the task's",
    "privileged": "of the critic, which does not fly",
    "nominal": "the same",
    "bounds": "what an exported contract says of observations",
}
"""Fields of an architecture that a proof is for any value of, and why."""
_PROVED: dict[str, Any] = {
    "activation": "tanh",
    "zoom": 0.0,
    "symmetries": None,
    "bf16": False,
    "head": "on-off",
    "levers": (),
    "backbone": "dense",
    "tokens": (),
    "authority": (),
    "coast": 0.0,
    "farthest": 0.0,
    "farthest_lost": 0.0,
    "frugal": (),
    "reach": (),
    "filling": (),
    "adapts": False,
    "history": 0,
    "commands_only": False,
    "averages": (),
    "filters": None,
    "units": 0,
    "clip": 10.0,
}
"""The one value of each other field that the formulas of prover and checker are of."""


def check_architecture(architecture: Architecture) -> None:
    """Refuse (`ConfigError`) networks that the formulas of a trapping set are not of.

    A new field of `Architecture` is refused until it is named here, as free or with its one value.
    """
    for name in (field.name for field in fields(architecture)):
        if name in _FREE:
            continue
        value = getattr(architecture, name)
        if name not in _PROVED or value != _PROVED[name] or type(value) is not type(_PROVED[name]):
            raise ConfigError(
                "trapping sets are proved for on/off agents of dense tanh layers without memory, zoom and "
                f"symmetry, and this one's {name} is {brief(value)}."
            )
    if architecture.layout != layout(TrackVelocity(), 2):
        raise ConfigError(
            "trapping sets are proved for agents that observe track-velocity in the plane."
        )


class Formulas(NamedTuple):
    """What is compared with a flight."""

    log_odds: Callable[[np.ndarray], np.ndarray]
    """Log-odds (N, thrusters) of states (N, 3): velocity in B (m/s) and spin (rad/s)."""
    moved: Callable[[np.ndarray, np.ndarray], np.ndarray]
    """Velocity in B of before and spin, (N, 3), a period after states (N, 3) under commands (N, thrusters)."""
    period: float
    """Control period, s."""


def check_as_flown(certificate: bytes, files: Mapping[str, bytes]) -> None:
    """Compare what the checker of trapping sets takes an agent for with its flight.

    Raises:
        Refused: they differ, a file is damaged, or the certificate is of another agent.
    """
    from rans_proof.balls import Refused
    from rans_proof.check_trap import formulas

    own = formulas(certificate, files)
    try:
        run = read_run(files)
        assert isinstance(run.controller, Agent)
        check_architecture(run.network.architecture)
        keep = read_certificate(certificate, "the certificate").keep
        check_flown(run, Formulas(*own), keep)
    except RansError as error:
        raise Refused(str(error)) from error


def read_run(files: Mapping[str, bytes]) -> LoadedRun:
    """The run of an agent's files, as flights load it.

    Raises:
        ConfigError: a file is damaged, or they are not of one agent.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name in FILES:
            (Path(folder) / name).write_bytes(files[name])
        try:
            return load_policy(Path(folder))
        except ConfigError as error:  # the user has never heard of that folder
            raise ConfigError(str(error).replace(f"{folder}/", "")) from error


def check_flown(
    run: LoadedRun, formulas: Formulas, keep: Mapping[str, float], states: int = _STATES
) -> None:
    """Compare formulas with a flight of a control period from random states.

    Args:
        run: run of the agent.
        formulas: of its closed loop.
        keep: limits of speed (m/s) and spin (rad/s), up to which states are.
        states: number of states.

    Raises:
        ConfigError: they differ.
    """
    if type(run.task) is not TrackVelocity or run.craft.dimension != 2:
        raise ConfigError("trapping sets are proved for agents of track-velocity in the plane.")
    if run.timing.control_period != formulas.period:
        raise ConfigError(
            f"its flights have a control period of {run.timing.control_period:g} s, and its proof one of "
            f"{formulas.period:g} s."
        )
    # States within the limits, with random headings, and a goal that is at rest.
    random = np.random.default_rng(0)
    angle = random.uniform(-np.pi, np.pi, states)
    speed = keep["speed"] * np.sqrt(random.random(states))
    spin = random.uniform(-keep["spin"], keep["spin"], states)
    begin = np.column_stack((speed * np.cos(angle), speed * np.sin(angle), spin))
    heading = random.uniform(-np.pi, np.pi, states)
    zero = np.zeros(states)
    velocity = Vec2(*_turned(begin[:, :2], heading).T)
    start = PlanarState(Vec2(zero, zero), Heading(heading), velocity, spin)
    goal = PlanarState(Vec2(zero, zero), Heading(zero), Vec2(zero, zero), zero)
    recorder = _Recorder(run)
    flight = fly(
        run.craft, run.task, recorder, Scenario(start, goal), replace(run.timing, episode_steps=1)
    )
    # Log-odds, of the network as it flies and of its numbers in double precision.
    proved = formulas.log_odds(begin)
    for flown, bound, precision in (
        (recorder.log_odds, LARGEST_ROUNDING, "single"),
        (recorder.double_log_odds, LARGEST_GAP, "double"),
    ):
        _compare("log-odds", proved, flown, bound, f"the flown network in {precision} precision")
    # The motion.
    v, w = flight.states.v, flight.states.w
    after = np.column_stack((v.x[1], v.y[1]))
    ends = np.column_stack((_turned(after, -heading), w[1]))
    commands = np.asarray(flight.commands[0], float)
    bound = _LARGEST_STEP * max(1.0, *keep.values())
    _compare("motion", formulas.moved(begin, commands), ends, bound, "a flight of one period")


def _compare(what: str, proved: np.ndarray, flown: np.ndarray, bound: float, flight: str) -> None:
    """Refuse (`ConfigError`) numbers that differ by more than a bound."""
    if proved.shape != flown.shape:
        raise ConfigError(f"its {what} are of another number of commands than those of {flight}.")
    gap = float(np.abs(proved - flown).max())
    if not gap <= bound:
        raise ConfigError(
            f"its {what} in the proof and in {flight} differ by {gap:.3g}, and at most {bound:g} is accepted; the "
            "usual cause is a file that says two things."
        )


class _Recorder:
    """Controller that flies an agent and keeps its log-odds."""

    name = "the agent of a proof"

    def __init__(self, run: LoadedRun) -> None:
        assert isinstance(run.controller, Agent)
        self._agent = run.controller
        self.log_odds = self.double_log_odds = np.zeros(0)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._agent.reset(count)

    @torch.no_grad()
    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) of the agent; stores its log-odds in single and in double precision beside them.

        The double-precision log-odds are what a proof's formulas are compared with.
        """
        network = self._agent.network
        double = type(network)(
            network.architecture, {name: x.double() for name, x in network.tensors.items()}
        )
        x = torch.from_numpy(observation)
        self.log_odds = _log_odds(network, x)
        self.double_log_odds = _log_odds(double, x.double())
        return self._agent.act(state, goal, observation)


def _log_odds(network: Network, observation: torch.Tensor) -> np.ndarray:
    """Log-odds (N, thrusters) of observations (N, width)."""
    policy = network.evaluate(observation).policy
    assert isinstance(policy, OnOff)
    return policy.logit.double().numpy()


def _turned(vectors: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Vectors (N, 2) turned by angles (N,)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = vectors.T
    return np.column_stack((c * x - s * y, s * x + c * y))
