"""Uneven orbits in Drake: faulty craft that are pushed fly alike in the engine and in Drake."""

from dataclasses import replace

import numpy as np
import pytest
from rans_missions.orbits.elliptic import EllipticOrbit
from rans_missions.orbits.perturbed import PerturbedOrbit

from rans import ConfigError
from rans.effectors.motion import states_at_checks
from rans.model.dynamics import Wrench
from rans.model.fields import Vec2, Vec3, leaves
from rans.reference.flight import rows_from_states, states_from_rows
from rans.reference.plant import Plant
from tests.reference.test_worlds import ACTUATORS, COUNT, TOLERANCE, gap, world
from tests.support.crafts import nasty_spatial, random_states

ELLIPSE = EllipticOrbit(0.11, 0.4, 0.0)
OBLATE = PerturbedOrbit(0.11, 1e-4, 0.9, 1e-3, 0.0)
"""What is of the second order in its oblateness, 1e-8 of the pull of the orbit, is below the tolerance."""


@pytest.mark.parametrize(
    ("dimension", "kind", "own"),
    [
        (2, "few counts", ELLIPSE),
        (3, "on-off", ELLIPSE),
        (3, "few counts", OBLATE),
        (2, "few counts", replace(OBLATE, inclination=0.0)),
    ],
)
def test_unsteady_orbits_and_faulty_craft_that_are_pushed_fly_alike(dimension, kind, own):
    """Both craft are at other places of an orbit that lasts a minute; pulses and substeps divide its periods."""
    built = world(dimension, "orbit", ACTUATORS[kind])
    places = np.array([0.3, 2.0])
    drift = replace(own, angle=places)
    push = (
        Wrench(Vec2(0.02, -0.03), 0.004)
        if dimension == 2
        else Wrench(Vec3(0.02, -0.03, 0.01), Vec3(0.004, 0.002, -0.003))
    )
    disturbances = np.tile(leaves(push), (COUNT, 1))
    plant = Plant(built.craft, COUNT, 0.005, built.body, own)
    state = random_states(dimension, COUNT, 3, speed=0.1, spin=0.1)
    rows = rows_from_states(state)
    commands = np.random.default_rng(2).integers(0, 2, (4, COUNT, len(built.craft.thrusters)))
    for k, command in enumerate(commands):
        now = drift.later(0.2 * k)
        state = states_at_checks(
            state,
            built.craft,
            built.body,
            tuple(command.astype(float).T),
            built.timing,
            now,
            disturbance=push,
        )[-1]
        rows = plant.advance(rows, command.astype(float), 0.2, disturbances, drift=now)
    assert gap(states_from_rows(rows, state).normalised(), state) < TOLERANCE


@pytest.mark.parametrize("own", [ELLIPSE, OBLATE])
def test_a_plant_refuses_another_orbit(own):
    craft = nasty_spatial()
    still = np.zeros((1, craft.command_count))
    plant = Plant(craft, drift=own)
    rows = rows_from_states(random_states(3, 1, 3))
    plant.advance(rows, still, 0.2, drift=own.later(9.0))
    with pytest.raises(ConfigError, match="the plant was built for"):
        plant.advance(rows, still, 0.2, drift=replace(own, mean_motion=0.2))
