"""Lost thrusters and other masses are estimated in flight, by every executor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from rans_any_craft.adaptation import Adaptation
from rans_any_craft.backbone import ALLOCATED
from rans_any_craft.networks import for_craft

from rans.base.errors import ConfigError
from rans.episode.flight import Flight
from rans.evaluation.fly.agent import Agent
from rans.evaluation.fly.any_craft import for_spacecraft
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.aggregate import measure
from rans.fast.agent_files.agent import actor_bytes, read_policy
from rans.fast.machine_code import compiled_preprocessor
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.policy.network import Network
from rans.policy.preprocess import TorchRows
from rans.randomization.conditions import Conditions, FaultConditions
from rans.tasks import GoToPose
from tests.support.crafts import heavier

PERIOD = 0.2


def network(name: str) -> Network:
    craft = load_spacecraft(name)
    agent = contestant(f"adaptive:any-craft-{craft.dimension}d").controller
    assert isinstance(agent, Agent)
    return for_craft(agent.network, craft, PERIOD)


def estimator_of(flown: Network) -> Adaptation:
    """The estimator of a network that adapts, which is that of this package."""
    found = flown.architecture.adaptation
    assert isinstance(found, Adaptation)
    return found


class Flown:
    """An estimator beside a craft that accelerates by a gain times its file's values, and has lost a thruster."""

    def __init__(self, name: str, gain: float, lost: int | None, noise: float = 0.0) -> None:
        self.adaptation = estimator_of(network(name))
        self.random = np.random.default_rng(1)
        self.works = np.ones(len(self.adaptation.effects))
        if lost is not None:
            self.works[lost] = 0.0
        self.gain = gain
        self.noise = noise

    def after(self, periods: int) -> tuple[list[float], list[float]]:
        """Gains and shut thrusters after random commands, while the craft turns."""
        own = self.adaptation
        columns = np.array(own.effects)
        twist = np.zeros(own.twist)
        memory = torch.zeros(1, own.width)
        rows = TorchRows(memory)
        gains: list[float] = []
        shut = np.zeros(own.thrusters)
        for _ in range(periods):
            read = twist + self.noise * self.random.normal(size=own.twist)
            estimate = own.estimated(rows, torch.tensor(read[None], dtype=torch.float32), memory)
            gains = [float(x) for x in estimate.gains]
            shut = estimate.shut[0].double().numpy()
            # Of some random commands the one after which the craft moves least.
            commands = (self.random.random((3, len(columns))) < 0.4) * (1.0 - shut)
            opened = commands * self.works
            if own.is_shared:
                opened = opened / np.maximum(opened.sum(axis=1, keepdims=True), 1.0)
            changes = self.gain * opened @ columns
            best = int(np.abs(twist + changes).sum(axis=1).argmin())
            command = commands[best]
            change = changes[best]
            memory = own.next_memory(
                rows, estimate.memory, torch.tensor(command[None], dtype=torch.float32)
            )
            # The velocity in B turns against the craft by its mean spin.
            angle = -(twist[2] + 0.5 * change[2]) * PERIOD
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            twist = np.r_[turn @ twist[:2] + change[:2], twist[2] + change[2]]
        return gains, shut.tolist()


@pytest.mark.parametrize(
    ("name", "gain", "lost"),
    [
        ("floating-platform", 1.0, None),
        ("floating-platform", 2.0, 3),
        ("floating-platform-shared", 0.5, 0),
    ],
)
def test_a_lost_thruster_is_shut(name: str, gain: float, lost: int | None) -> None:
    _, shut = Flown(name, gain, lost, noise=0.003).after(60)
    assert shut == [float(k == lost) for k in range(8)]


@pytest.mark.parametrize(("part", "shut"), [(0.5, 0.0), (0.0, 1.0)])
def test_a_weak_thruster_that_the_craft_needs_stays_in_use(part: float, shut: float) -> None:
    flown = Flown("floating-platform", 1.0, 3, noise=0.003)
    flown.works[3] = part
    flown.adaptation = flown.adaptation._replace(weak=flown.adaptation.spare)
    assert flown.after(60)[1] == [0.0, 0.0, 0.0, shut, 0.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_gains_of_another_mass(gain: float) -> None:
    gains, shut = Flown("floating-platform", gain, None).after(40)
    assert gains == pytest.approx([gain, gain], rel=0.1)
    assert shut == [0.0] * 8


def begun(*columns):
    """Estimator of a craft that can spare no thruster, its arithmetic and its memory."""
    own = Adaptation(PERIOD, columns, 2, False, ())
    rows = TorchRows(torch.zeros(1, dtype=torch.float64))
    return own, rows, rows.constant([[0.0] * own.width])


def test_one_reading_by_hand() -> None:
    """A craft that cannot spare a thruster: the scalar formulas of least squares with an instrument."""
    own, rows, memory = begun((0.1, 0.0, 0.0), (0.0, 0.2, 0.3))
    # At rest for two readings; then the first command has given half of what the file says along x.
    for command in ([0.0, 0.0], [1.0, 0.0]):
        estimate = own.estimated(rows, rows.constant([[0.0, 0.0, 0.0]]), memory)
        memory = own.next_memory(rows, estimate.memory, rows.constant([command]))
    estimate = own.estimated(rows, rows.constant([[0.05, 0.0, 0.0]]), memory)
    noise = 0.0045**2 + (0.15**2 + 0.15**2 + 0.25**2) * 0.1**2
    variance = 1.0 / (1.0 / (0.4**2 + 1e-4) + 0.1**2 / noise)
    assert float(estimate.gains[0]) == pytest.approx(1.0 - variance * 0.1 * 0.05 / noise)
    assert float(estimate.gains[1]) == 1.0
    assert estimate.shut.tolist() == [[0.0, 0.0]]


def test_a_craft_that_moves_at_the_start_has_its_own_mass() -> None:
    """A velocity before any command says nothing; then each command gives all of its effect."""
    own, rows, memory = begun((0.02, 0.0, 0.0), (0.0, 0.02, 0.03))
    for number in range(4):
        twist = [0.3 + 0.02 * number, 0.0, 0.0]
        estimate = own.estimated(rows, rows.constant([twist]), memory)
        assert [float(gain) for gain in estimate.gains] == pytest.approx([1.0, 1.0])
        memory = own.next_memory(rows, estimate.memory, rows.constant([[1.0, 0.0]]))


def test_an_estimated_craft_gets_the_columns_of_its_file() -> None:
    """With half of the gains the network is given what it is given of a craft with twice the mass."""
    craft = load_spacecraft("floating-platform")
    plain = contestant("any-craft-2d").controller
    assert isinstance(plain, Agent)
    row = [0.6, 0.8, 0.1, -0.2, 0.3, 1.0, 1.5, -0.4, 0.28, 0.96]
    stated = for_craft(plain.network, heavier(craft, 2.0, 2.0), PERIOD).architecture.preprocessed(
        row
    )
    architecture = network("floating-platform").architecture
    read = architecture.preprocessed(row)
    assert ALLOCATED.adapted(architecture, read, [0.5, 0.5], 0.0) == pytest.approx(stated)


@pytest.mark.parametrize(
    "name", [pytest.param("floating-platform-shared", marks=pytest.mark.slow), "cubesat-6u"]
)
def test_machine_code_estimates_the_same(name: str) -> None:
    pytest.importorskip("llvmlite")
    plain = network(name)
    coded = Network(plain.architecture, plain.tensors, preprocessor=compiled_preprocessor)
    random = torch.Generator().manual_seed(3)
    states = [plain.initial_state(40), coded.initial_state(40)]
    # CubeSats check their thrusters for eight periods.
    for _ in range(12):
        seen = 0.3 * torch.randn(40, plain.architecture.layout.width, generator=random)
        expected, states[0] = plain.deterministic_action(seen, states[0])
        found, states[1] = coded.deterministic_action(seen, states[1])
        # Duty cycles, and roundings of logarithms of odds, up to 20, in float32.
        torch.testing.assert_close(found, expected, atol=1e-3, rtol=0.0)
        torch.testing.assert_close(states[1], states[0], atol=1e-3, rtol=1e-3)


def cubesat(dead: int | None, steps: int | None = None) -> tuple[Flight, Adaptation]:
    """Sixteen flights of cubesat-6u by the adapting agent, with a dead thruster or none, and its estimator.

    They last for so many steps, or for 80 s.
    """
    timing = Timing(0.5, 1, steps or 160)
    run = for_spacecraft(contestant("adaptive:any-craft-3d"), load_spacecraft("cubesat-6u"), timing)
    task = GoToPose(spawn_distance=(1.0, 1.5), evaluation_distance=(1.0, 1.5))
    conditions = Conditions()
    if dead is not None:
        conditions = Conditions(faults=FaultConditions(kinds=("dead",), thrusters=(dead,)))
    run = run._replace(task=task, conditions=conditions)
    assert isinstance(run.controller, Agent)
    flight = fly_episodes(run.controller, run.judged, 5, 16, workers=1)
    return flight, estimator_of(run.network)


@pytest.mark.slow
def test_momenta_of_wheels_are_those_of_the_engine() -> None:
    """The engine integrates the torques of wheels; the agent has their commands alone."""
    flight, own = cubesat(None, 80)
    rows = TorchRows(torch.zeros(1))
    memory = torch.zeros(16, own.width)
    full = np.array([wheel.max_momentum for wheel in flight.craft.wheels])
    for command, *stores in zip(flight.commands, *flight.states.stores, strict=False):
        estimate = own.estimated(rows, torch.zeros(16, 6), memory)
        momenta = estimate.known[1][:, :3].numpy()
        np.testing.assert_allclose(momenta, np.stack(stores, axis=1) / full, atol=1e-3)
        # Networks command wheels from 0 to 1.
        share = np.hstack([command[:, :8], 0.5 + 0.5 * command[:, 8:]])
        memory = own.next_memory(rows, estimate.memory, torch.tensor(share, dtype=torch.float32))


def test_a_cubesat_checks_its_thrusters_first() -> None:
    flight, _ = cubesat(None, 12)
    checks, flown = np.split(flight.commands, [8])
    assert (checks[:, :, :8].sum(axis=2) == 2.0).all()
    assert (checks[:, :, :8].sum(axis=0) == 2.0).all()
    assert (checks[:, :, 8:] == 0.0).all()
    assert flown[0, :, 8:].any()


@pytest.mark.slow
def test_a_cubesat_flies_without_a_thruster_that_no_file_leaves_out() -> None:
    """Fifteen in a hundred settle without checks and memory of momenta."""
    flight, _ = cubesat(5)
    assert {row.name: row for row in measure(flight).rows}["solved"].value > 50.0


@pytest.mark.parametrize("spec", ["adaptive:lqr:go-to-pose-2d", "adaptive:go-to-pose-2d"])
def test_others_do_not_adapt(spec: str) -> None:
    with pytest.raises(ConfigError, match="adaptive:any-craft-2d"):
        contestant(spec)


def test_files_whose_wheels_fill_up_otherwise_are_refused(tmp_path: Path) -> None:
    plain = network("cubesat-6u")
    file = tmp_path / "agent.safetensors"
    for filling in ((0.2,), (0.2, 0.2, 0.0)):
        damaged = replace(plain.architecture, filling=filling)
        file.write_bytes(actor_bytes(damaged, plain.weights(), 0))
        with pytest.raises(ConfigError, match="filling"):
            read_policy(file)


def test_a_lost_thruster_takes_nothing_of_the_supply() -> None:
    """Two open thrusters give half each; once one is lost, it gives a fifth and the other one its whole.

    Squares are those of the halves.
    """
    effects = ((1.0, 0.0, 0.5), (0.0, 2.0, -0.5), (-1.0, 0.0, 0.0))
    own = Adaptation(PERIOD, effects, 3, True, spare=(1,))
    command = torch.tensor([[1.0, 1.0, 0.0]])
    changes = torch.stack(own._effects(TorchRows(command), command), dim=-1)[0]
    torch.testing.assert_close(changes[0], torch.tensor([0.5, 1.0, 0.0]))
    torch.testing.assert_close(changes[1], torch.tensor([1.0, 0.4, 0.4]))
    squares = own._squares(TorchRows(command), command)[0]
    torch.testing.assert_close(squares, torch.tensor([0.25, 1.0, 0.125]))


@pytest.mark.parametrize(("weak", "shut"), [(4.0, 1.0), (5.6, 0.0)])
def test_after_checks_little_evidence_keeps_a_lost_thruster_shut(weak: float, shut: float) -> None:
    """Odds of 6 for lost: a weak one that stays in use is preferred by at most 1, and by 4 without checks."""
    effects = ((1.0, 0.0, 0.5), (0.0, 2.0, -0.5), (-1.0, 0.0, 0.0))
    for has_checks in (True, False):
        own = Adaptation(PERIOD, effects, 3, False, spare=(0,), weak=(0,), has_checks=has_checks)
        at_rest = [0.0] * (2 * own.twist + 2 * len(effects))
        beliefs = [*[1.0] * 6, *[0.1] * 6]
        memory = torch.tensor([[*at_rest, *beliefs, 0.0, 6.0, weak]])
        estimate = own.estimated(TorchRows(memory), torch.zeros(1, own.twist), memory)
        assert estimate.shut[0].tolist() == [shut if has_checks else 0.0, 0.0, 0.0]
