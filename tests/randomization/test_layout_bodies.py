"""Random layouts of thrusters: geometry, and the same motion in every engine as a spacecraft of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import rans
from rans.episode import Setup, World
from rans.errors import ConfigError
from rans.flight import Flight, fly
from rans.model.actuators import Pulsed
from rans.model.body import Body
from rans.model.fields import leaves, map_leaves
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions, LayoutConditions
from rans.randomization.layout_bodies import layout_bodies, layout_spacecraft
from rans.randomization.layouts import LayoutRanges, layouts
from rans.randomization.parameters import examples
from rans.scenario import draws, scenarios
from rans.tasks import observation_width
from tests.support.played import Played

CRAFT = rans.load_spacecraft("floating-platform")
IN_SPACE = rans.load_spacecraft("free-flyer")
both_dimensions = pytest.mark.parametrize("craft", [CRAFT, IN_SPACE], ids=["plane", "space"])
RANDOM = Conditions(layouts=LayoutConditions(count=4, seed=3))
TIMING = Timing(0.2, 1, 8)


def drawn(craft: rans.Spacecraft, count: int = 4, seed: int = 3) -> list[np.ndarray]:
    """The layouts of `RANDOM` for a craft; in space six numbers of a twist need seven thrusters that only push."""
    plane = craft.dimension == 2
    fewest = 4 if plane else 7
    ranges = LayoutRanges(craft.dimension, fewest, craft.thruster_count, moments=0.0)
    return list(layouts(count, seed, ranges))


DRAWN = drawn(CRAFT)


def commands(count: int, craft: rans.Spacecraft = CRAFT) -> np.ndarray:
    shape = (TIMING.episode_steps, count, craft.thruster_count)
    random = np.random.default_rng(1)
    return random.random(shape) if craft.is_continuous else random.integers(0, 2, shape) * 1.0


def flown(
    conditions: Conditions,
    craft: rans.Spacecraft = CRAFT,
    given: np.ndarray | None = None,
    timing: Timing = TIMING,
) -> Flight:
    count = 4
    starts = scenarios(rans.GoToPose(), craft, 0, count)
    played = Played(commands(count, craft) if given is None else given)
    return fly(
        craft, rans.GoToPose(), played, starts, timing, conditions=conditions, draws=draws(0, count)
    )


def flown_alone(number: int, usual: rans.Spacecraft) -> Flight:
    """Flight of a layout as a spacecraft of its own, whose file has these thrusters only."""
    craft = layout_spacecraft(usual, drawn(usual)[number])
    start = map_leaves(lambda x: x[number : number + 1], scenarios(rans.GoToPose(), usual, 0, 4))
    played = Played(commands(4, usual)[:, number : number + 1, : craft.thruster_count])
    return fly(craft, rans.GoToPose(), played, start, TIMING)


def difference(a: Any, b: Any) -> float:
    return max(float(np.abs(x - y).max()) for x, y in zip(leaves(a), leaves(b), strict=True))


@pytest.mark.filterwarnings("ignore:.*cannot push and turn it")
def test_layout_has_the_mean_force_and_the_distance_of_the_craft() -> None:
    # Two thrusters 0.5 m and one 1 m from the centre: their root mean square distance is sqrt(0.5) m.
    craft = rans.Spacecraft.planar(
        "three",
        2.0,
        0.1,
        (
            ((0.5, 0.0), (0.0, 1.0), 1.0),
            ((-0.5, 0.0), (0.0, -1.0), 2.0),
            ((0.0, 1.0), (1.0, -1.0), 3.0),
        ),
    )
    layout = np.array([[3.0, 4.0, 10.0], [0.0, -1.0, 0.5], [1.0, 0.0, 0.0]])
    own = layout_spacecraft(craft, layout)
    assert [t.force for t in own.thrusters] == pytest.approx([10.0, 2.0, 2.0])
    # Torque 10 of a force of 5 is an arm of 2, to the right of its direction.
    arm = np.sqrt(0.5) * 2.0
    assert own.thrusters[0].position == pytest.approx((0.8 * arm, -0.6 * arm, 0.0))
    assert own.thrusters[1].position == pytest.approx((-np.sqrt(0.5) * 0.5, 0.0, 0.0))
    assert (own.mass, own.inertia) == (craft.mass, craft.inertia)


@both_dimensions
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_wrenches_are_the_columns(craft: rans.Spacecraft, seed: int) -> None:
    (layout,) = drawn(craft, 1, seed)
    places = np.array([t.position for t in craft.thrusters]) - craft.centre_of_mass
    distance = np.sqrt(np.square(places).sum(axis=1).mean())
    force = np.mean([t.force for t in craft.thrusters])
    pushing = craft.dimension
    expected = layout * force * np.repeat([1.0, distance], [pushing, layout.shape[1] - pushing])
    assert np.allclose(layout_spacecraft(craft, layout).wrench_map, expected, atol=1e-12)


def test_columns_that_no_thruster_has_are_refused() -> None:
    unequal = next(layouts(1, 3, LayoutRanges(3, 8, 16)))  # their moments of inertia differ
    for craft, layout in ((IN_SPACE, unequal), (IN_SPACE, DRAWN[0]), (CRAFT, unequal)):
        with pytest.raises(ConfigError, match="layout"):
            layout_spacecraft(craft, layout)


@pytest.mark.parametrize(
    "craft",
    [
        CRAFT,
        rans.load_spacecraft("freeflyer2"),
        replace(IN_SPACE, actuators=Pulsed(3)),
    ],
    ids=lambda craft: f"{craft.name} {craft.actuators.kind}",
)
def test_episodes_fly_as_spacecraft_of_their_own(craft: rans.Spacecraft) -> None:
    every = flown(RANDOM, craft)
    for number in range(4):
        alone = flown_alone(number, craft)
        own = map_leaves(lambda x, k=number: x[:, k : k + 1], every.states)
        # Rounding of sums in another order.
        assert difference(own, alone.states) < 1e-12
    assert {len(layout) for layout in drawn(craft)} != {craft.thruster_count}


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_any_layout_flies_as_a_spacecraft_of_its_own(seed: int) -> None:
    (layout,) = layouts(1, seed, LayoutRanges(most=8))
    every = flown(Conditions(layouts=LayoutConditions(count=1, seed=seed)))
    starts = scenarios(rans.GoToPose(), CRAFT, 0, 4)
    played = Played(commands(4)[:, :, : len(layout)])
    alone = fly(layout_spacecraft(CRAFT, layout), rans.GoToPose(), played, starts, TIMING)
    assert difference(every.states, alone.states) < 1e-12


def test_environments_have_the_layouts_of_their_episodes() -> None:
    every = flown(RANDOM)
    environment = gymnasium.make(
        "rans/GoToPose2D-v0", spacecraft=CRAFT, conditions=RANDOM, timing=TIMING
    ).unwrapped
    environment.reset(seed=0)
    for number in range(2):
        for command in commands(4)[:3, number]:
            environment.step(command.astype(np.int8))
        there = map_leaves(lambda x, k=number: x[3, k], every.states)
        assert difference(environment.state, there) < 1e-12  # type: ignore[attr-defined]
        environment.reset()


@both_dimensions
def test_commands_of_missing_thrusters_do_nothing(craft: rans.Spacecraft) -> None:
    count = craft.thruster_count
    fewer, size = next((k, len(x)) for k, x in enumerate(drawn(craft)) if len(x) < count)
    opened = commands(4, craft)
    opened[:, fewer, size:] = 1.0
    shut = opened.copy()
    shut[:, fewer, size:] = 0.0
    flights = [flown(RANDOM, craft, given) for given in (opened, shut)]
    assert difference(flights[0].states, flights[1].states) == 0.0


@pytest.mark.slow
@both_dimensions
def test_drake_flies_them_likewise(craft: rans.Spacecraft) -> None:
    from rans.reference.flight import fly_in_drake

    starts = scenarios(rans.GoToPose(), craft, 0, 4)
    judged = fly_in_drake(
        craft,
        rans.GoToPose(),
        Played(commands(4, craft)),
        starts,
        TIMING,
        conditions=RANDOM,
        draws=draws(0, 4),
    )
    # Drake's steps of 0.01 s are accurate to 1e-9, and so are steps of 0.05 s in space.
    finely = flown(RANDOM, craft, timing=replace(TIMING, substeps=4))
    assert difference(judged.states, finely.states) < 1e-8


@pytest.mark.parametrize("num_envs", [4, 3], ids=["each its own", "drawn anew"])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(
    ("craft", "plain"),
    [(CRAFT, False), (CRAFT, True), (IN_SPACE, False)],
    ids=["plane", "plain", "space"],
)
def test_engine_flies_them_likewise(
    craft: rans.Spacecraft, num_envs: int, dtype: torch.dtype, plain: bool
) -> None:
    engine = rans.Engine(
        craft,
        "go-to-pose",
        num_envs,
        Timing(0.2, 1, 6),
        dtype=dtype,
        conditions=RANDOM,
        plain=plain,
    )
    # Two episodes of every environment: with three of them the second has another layout.
    for step in range(8):
        engine.step(torch.as_tensor(commands(4, craft)[step % 6, :num_envs], dtype=dtype))
    numbers = np.arange(num_envs) + num_envs
    starts = scenarios(rans.GoToPose(), craft, 0, num_envs, num_envs)
    expected = fly(
        craft,
        rans.GoToPose(),
        Played(commands(4, craft)[:, :num_envs]),
        starts,
        Timing(0.2, 1, 2),
        conditions=RANDOM,
        draws=draws(0, num_envs, int(numbers[0])),
    )
    last = map_leaves(lambda x: x[-1], expected.states)
    found = map_leaves(np.asarray, engine.state)
    assert difference(found, last) < (1e-5 if dtype == torch.float32 else 1e-10)


def test_conditions_of_a_file_have_layouts(tmp_path: Any) -> None:
    file = tmp_path / "layouts.toml"
    file.write_text("[layouts]\ncount = 4\nseed = 3\n\n[thrusters]\npressure = [0.5, 2.0]\n")
    found = rans.load_conditions(file)
    assert found.layouts == LayoutConditions(4, 3)
    # Factors of other conditions apply to a layout as to the designed thrusters.
    starts = scenarios(rans.GoToPose(), CRAFT, 0, 4)
    world = World(Setup(CRAFT, rans.GoToPose(), TIMING, found))
    parameters = world.begin(starts.start, starts.goal, 0, draws(0, 4)).parameters
    assert parameters is not None
    gain = np.stack([x + np.zeros(4) for x in parameters.body.gain], axis=1)
    nominal = np.stack(layout_bodies(CRAFT, found.layouts).gain, axis=1)
    factors = gain[:, 0] / nominal[:, 0]
    assert np.ptp(factors) > 0.1
    assert np.allclose(gain, nominal * factors[:, None])


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: LayoutConditions(count=-1),
        lambda: LayoutConditions(count=2, fewest=3),
        lambda: LayoutConditions(count=2.5),  # type: ignore[arg-type]
        lambda: LayoutConditions(seed=3),  # without a number of layouts there would be none
    ],
)
def test_impossible_layouts_are_refused(wrong: Any) -> None:
    with pytest.raises(ConfigError, match="layouts"):
        Conditions(layouts=wrong())


def test_errors_of_the_designed_layout_are_refused() -> None:
    moved = rans.ThrusterConditions(position=0.01)
    with pytest.raises(ConfigError, match="position"):
        replace(RANDOM, thrusters=moved)
    with pytest.raises(ConfigError, match="droop"):
        replace(RANDOM, thrusters=rans.ThrusterConditions(droop=0.1))
    with pytest.raises(ConfigError, match="among"):
        replace(RANDOM, faults=rans.FaultConditions(count=1.0, among="recoverable"))


def test_thrusters_that_a_layout_has_fail() -> None:
    """One fault in every episode never goes to a missing thruster; eight kill all thrusters of the layout."""
    for failing in (1, 8):
        faults = rans.FaultConditions(count=float(failing), kinds=("dead",))
        drawn = examples(replace(RANDOM, faults=faults), CRAFT, 10)
        assert drawn.fault is not None
        before, after = (
            (np.array(gains) > 0.0).sum(axis=0) for gains in (drawn.body.gain, drawn.fault.gain)
        )
        assert set(before) > {4}
        np.testing.assert_array_equal(after, np.maximum(before - failing, 0))
    named = replace(RANDOM, faults=rans.FaultConditions(thrusters=(4,)))
    with pytest.raises(ConfigError, match="every random layout have the numbers 0 to 3"):
        named.check_craft(CRAFT)


def test_engines_that_cannot_have_them_say_why() -> None:
    six = rans.load_spacecraft("afrl-deputy")
    with pytest.raises(ConfigError, match="at least 7"):
        rans.Engine(six, "go-to-pose", 4, conditions=RANDOM)
    with pytest.raises(ConfigError, match="thrust_sharing"):
        rans.Engine("floating-platform-shared", "go-to-pose", 4, conditions=RANDOM)
    with pytest.warns(UserWarning, match="not a multiple of layouts.count"):
        assert not rans.Engine(CRAFT, "go-to-pose", 6, conditions=RANDOM, compiled=True).compiled
    body = Body.of(CRAFT)
    with pytest.raises(ConfigError, match="body"):
        rans.Engine(CRAFT, "go-to-pose", 4, conditions=RANDOM, body=body)


def observed_thrusters(num_envs: int, conditions: Conditions = RANDOM, **how: Any) -> np.ndarray:
    """Observed thrusters (N, 9, 3) of a craft with eight."""
    task = rans.GoToPose(observed_thrusters=9)
    engine = rans.Engine(CRAFT, task, num_envs, Timing(0.2, 1, 4), conditions=conditions, **how)
    shut = torch.zeros(num_envs, 8, dtype=how.get("dtype", torch.float32))
    for _ in range(4):
        engine.step(shut)
    rows = np.asarray(engine.step(shut).observation)
    assert rows.shape[1] == observation_width(rans.GoToPose(), 2) + 27
    return rows[:, -27:].reshape(num_envs, 9, 3)


@pytest.mark.parametrize("how", [{}, {"plain": True}, {"dtype": torch.float64}])
@pytest.mark.parametrize("num_envs", [4, 3])
def test_policies_observe_the_accelerations_of_thrusters(num_envs: int, how: Any) -> None:
    heavy = replace(RANDOM, body=rans.BodyConditions(mass=2.0, inertia=3.0))
    rows = observed_thrusters(num_envs, heavy, **how)
    designed = np.array(CRAFT.wrench_map)
    unit = np.abs(designed[:, 2]).mean()  # all thrusters of this craft turn it as much
    for number in range(num_envs):
        # The second episode of an environment.
        layout = DRAWN[(num_envs + number) % 4]
        own = np.array(layout_spacecraft(CRAFT, layout).wrench_map)
        expected = np.zeros((9, 3))
        expected[: len(layout)] = own / np.array([2.0, 2.0, 3.0 * unit])
        assert np.allclose(rows[number], expected, atol=1e-5)


def test_policies_observe_designed_thrusters_without_conditions() -> None:
    engine = rans.Engine(CRAFT, rans.GoToPose(observed_thrusters=8), 2)
    rows = np.asarray(engine.reset(0))[:, -24:].reshape(2, 8, 3)
    assert np.allclose(np.abs(rows[:, :, 2]), 1.0)
    assert np.allclose(np.linalg.norm(rows[:, :, :2], axis=2), 1.0)
    wheels = rans.Engine("innocube", rans.GoToAttitude(observed_thrusters=2), 2)
    assert not np.any(np.asarray(wheels.reset())[:, -12:])
    with pytest.raises(ConfigError, match="observed_thrusters"):
        rans.Engine(CRAFT, rans.GoToPose(observed_thrusters=7), 2)
    with pytest.raises(ConfigError, match="observed_thrusters"):
        rans.GoToPose(observed_thrusters=2.5)  # type: ignore[arg-type]


def test_flights_with_observed_thrusters_have_them_in_space_too() -> None:
    craft = rans.load_spacecraft("free-flyer")
    task = rans.GoToPose(observed_thrusters=craft.thruster_count)
    starts = scenarios(task, craft, 0, 2)
    seen: list[np.ndarray] = []

    class Looking(Played):
        def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
            seen.append(observation)
            return np.zeros((2, craft.command_count))

    fly(craft, task, Looking(np.zeros(0)), starts, Timing(0.2, 1, 2))
    table = np.array(craft.wrench_map)
    torque = np.sqrt(np.square(table[:, 3:]).sum(axis=1).mean())
    force = np.linalg.norm(table[:, :3], axis=1).mean()
    expected = table / np.repeat([force, torque], 3)
    assert np.allclose(seen[0][0, -table.size :].reshape(table.shape), expected, atol=1e-6)
