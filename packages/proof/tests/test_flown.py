"""Agents that say two things, and formulas that are not of the agent that flies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from rans_proof.flown import _FREE, _PROVED, Formulas, check_architecture, check_flown, read_run
from rans_proof.trap import velocity_loop
from rans_proof.trap_certificate import FILES

from rans.errors import ConfigError
from rans.fast.agent_files.agent import policy_of
from rans.policy.architecture import Architecture
from rans.tasks.derived import layout
from rans.tasks.go_to_pose import GoToPose
from tests.support.processes import ROOT

PRETRAINED = ROOT / "rans/data/pretrained/track-velocity-2d"
KEEP = {"speed": 0.16, "spin": 1.52}


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    return {name: (PRETRAINED / name).read_bytes() for name in FILES}


@pytest.fixture(scope="module")
def formulas(files: dict[str, bytes]) -> Formulas:
    """Those of the prover, which the checker shares no mathematics with."""
    run = read_run(files)
    loop = velocity_loop(run.network, run.craft, run.timing.control_period)

    def moved(states: np.ndarray, commands: np.ndarray) -> np.ndarray:
        impulse = loop.impulse(states[:, 2], commands)
        spin = states[:, 2] + commands @ loop.lever * loop.step
        return np.column_stack((states[:, :2] + impulse, spin))

    return Formulas(lambda x: loop.log_odds(x[:, :2], x[:, 2]), moved, loop.period)


def test_the_provers_formulas_are_the_flight(files: dict[str, bytes], formulas: Formulas) -> None:
    check_flown(read_run(files), formulas, KEEP)


def changed(states: np.ndarray, column: int, amount: float) -> np.ndarray:
    result = states.copy()
    result[:, column] += amount
    return result


WRONG: dict[str, Callable[[Formulas], Formulas]] = {
    "log-odds": lambda f: f._replace(log_odds=lambda x: f.log_odds(x) + 2e-4),
    "one thruster": lambda f: f._replace(log_odds=lambda x: f.log_odds(x)[:, [1, 0, *range(2, 8)]]),
    "another count": lambda f: f._replace(log_odds=lambda x: f.log_odds(x)[:, :7]),
    "no number": lambda f: f._replace(log_odds=lambda x: f.log_odds(x) * np.nan),
    "velocity": lambda f: f._replace(moved=lambda x, u: changed(f.moved(x, u), 1, 1e-5)),
    "spin": lambda f: f._replace(moved=lambda x, u: changed(f.moved(x, u), 2, 1e-5)),
    "an earlier state": lambda f: f._replace(moved=lambda x, u: x),
    "period": lambda f: f._replace(period=0.1),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_formulas_of_another_agent_are_refused(
    wrong: str, files: dict[str, bytes], formulas: Formulas
) -> None:
    with pytest.raises(ConfigError):
        check_flown(read_run(files), WRONG[wrong](formulas), KEEP)


OTHER: dict[str, Callable[[dict[str, bytes]], bytes]] = {
    "a heavier craft": lambda f: f["spacecraft.toml"].replace(b"mass = 5.32", b"mass = 5.33"),
    "a turned thruster": lambda f: f["spacecraft.toml"].replace(b"[1.0, -1.0]", b"[1.0, -1.01]", 1),
    "another task": lambda f: f["config.json"].replace(b"track-velocity", b"go-to-pose"),
    "a longer period": lambda f: f["config.json"].replace(b'"control_period": 0.2', b'"control_period": 0.25'),
}  # fmt: skip


@pytest.mark.parametrize("other", OTHER)
def test_another_flight_is_refused(other: str, files: dict[str, bytes], formulas: Formulas) -> None:
    """What a file says and the formulas do not know."""
    content = OTHER[other](files)
    name = "config.json" if b"curriculum" in content else "spacecraft.toml"
    assert content != files[name]
    with pytest.raises(ConfigError):
        check_flown(read_run(files | {name: content}), formulas, KEEP)


def test_every_field_of_an_architecture_is_checked(files: dict[str, bytes]) -> None:
    """A field is free for a stated reason or has one value; others of its type are refused."""
    network = policy_of(files["agent.safetensors"], PRETRAINED).network
    architecture = network.architecture
    check_architecture(architecture)
    assert {field.name for field in fields(Architecture)} == _FREE.keys() | _PROVED.keys()
    for name, value in _PROVED.items():
        other: Any = (1.0,)
        if isinstance(value, bool):
            other = not value
        elif isinstance(value, int | float):
            other = type(value)(value + 1)
        elif isinstance(value, str):
            other = "gaussian"
        with pytest.raises(ConfigError, match=name):
            check_architecture(replace(architecture, **{name: other}))
    with pytest.raises(ConfigError, match="observe"):
        check_architecture(replace(architecture, layout=layout(GoToPose(), 2)))
