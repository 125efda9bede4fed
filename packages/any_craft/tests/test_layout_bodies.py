"""Random layouts of thrusters: geometry, and the same motion in every engine as a spacecraft of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from rans_any_craft.layout_bodies import layout_bodies, layout_spacecraft
from rans_any_craft.layouts import LayoutRanges, layouts

import rans
from rans.episode import Setup, World
from rans.errors import ConfigError
from rans.flight import Flight, fly
from rans.model.actuators import Pulsed
from rans.model.body import Body
from rans.model.fields import leaves, map_leaves
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.scenario import draws, scenarios
from tests.support.played import Played

CRAFT = rans.load_spacecraft("floating-platform")
IN_SPACE = rans.load_spacecraft("free-flyer")
both_dimensions = pytest.mark.parametrize("craft", [CRAFT, IN_SPACE], ids=["plane", "space"])
TIMING = Timing(0.2, 1, 8)


def drawn(craft: rans.Spacecraft, count: int = 4, seed: int = 3) -> list[np.ndarray]:
    """Layouts of a craft; in space six numbers of a twist need seven thrusters that only push."""
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
    body: Body,
    craft: rans.Spacecraft = CRAFT,
    given: np.ndarray | None = None,
    timing: Timing = TIMING,
) -> Flight:
    starts = scenarios(rans.GoToPose(), craft, 0, 4)
    played = Played(commands(4, craft) if given is None else given)
    return fly(craft, rans.GoToPose(), played, starts, timing, body=body)


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
    every = flown(layout_bodies(craft, 4, 3), craft)
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
    every = flown(layout_bodies(CRAFT, 1, seed))
    starts = scenarios(rans.GoToPose(), CRAFT, 0, 4)
    played = Played(commands(4)[:, :, : len(layout)])
    alone = fly(layout_spacecraft(CRAFT, layout), rans.GoToPose(), played, starts, TIMING)
    assert difference(every.states, alone.states) < 1e-12


@both_dimensions
def test_commands_of_missing_thrusters_do_nothing(craft: rans.Spacecraft) -> None:
    count = craft.thruster_count
    fewer, size = next((k, len(x)) for k, x in enumerate(drawn(craft)) if len(x) < count)
    opened = commands(4, craft)
    opened[:, fewer, size:] = 1.0
    shut = opened.copy()
    shut[:, fewer, size:] = 0.0
    flights = [flown(layout_bodies(craft, 4, 3), craft, given) for given in (opened, shut)]
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
        body=layout_bodies(craft, 4, 3),
    )
    # Drake's steps of 0.01 s are accurate to 1e-9, and so are steps of 0.05 s in space.
    finely = flown(layout_bodies(craft, 4, 3), craft, timing=replace(TIMING, substeps=4))
    assert difference(judged.states, finely.states) < 1e-8


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(
    ("craft", "plain"),
    [(CRAFT, False), (CRAFT, True), (IN_SPACE, False)],
    ids=["plane", "plain", "space"],
)
def test_engine_flies_them_likewise(
    craft: rans.Spacecraft, dtype: torch.dtype, plain: bool
) -> None:
    body = layout_bodies(craft, 4, 3)
    engine = rans.Engine(
        craft, "go-to-pose", 4, Timing(0.2, 1, 6), dtype=dtype, body=body, plain=plain
    )
    # Two episodes of every environment, which keeps its layout.
    for step in range(8):
        engine.step(torch.as_tensor(commands(4, craft)[step % 6], dtype=dtype))
    starts = scenarios(rans.GoToPose(), craft, 0, 4, 4)
    played = Played(commands(4, craft))
    expected = fly(craft, rans.GoToPose(), played, starts, Timing(0.2, 1, 2), body=body)
    last = map_leaves(lambda x: x[-1], expected.states)
    found = map_leaves(np.asarray, engine.state)
    assert difference(found, last) < (1e-5 if dtype == torch.float32 else 1e-10)


def test_factors_of_conditions_apply_to_a_layout() -> None:
    """As to the designed thrusters: half of the pressure halves the gain of every thruster."""
    body = layout_bodies(CRAFT, 4, 3)
    starts = scenarios(rans.GoToPose(), CRAFT, 0, 4)
    weak = Conditions(thrusters=rans.ThrusterConditions(pressure=0.5))
    world = World(Setup(CRAFT, rans.GoToPose(), TIMING, weak))
    parameters = world.begin(starts.start, starts.goal, 0, draws(0, 4), body).parameters
    assert parameters is not None
    assert np.allclose(parameters.body.gain, 0.5 * np.array(body.gain))
    assert parameters.body.mountings is body.mountings


@pytest.mark.parametrize("name", ["afrl-deputy", "floating-platform-shared"])
def test_craft_that_cannot_have_random_layouts_are_refused(name: str) -> None:
    with pytest.raises(ConfigError, match=r"at least [47] thrusters that do not share"):
        layout_bodies(rans.load_spacecraft(name), 4)
