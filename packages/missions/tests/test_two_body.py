"""Two-body gravity against Kepler's conserved quantities, closed orbits, and orbits that RANS flies."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.orbits.earth import EARTH
from rans_missions.orbits.elliptic import EllipticOrbit, mean_anomaly
from rans_missions.tasks import Dock
from rans_missions.two_body import (
    J2,
    Perturbations,
    TwoBodyMover,
    density,
    perturbed_motion,
    relative_motion,
)
from scipy.integrate import solve_ivp

from rans.errors import ConfigError
from rans.flight import fly
from rans.model.drift import ClohessyWiltshire
from rans.model.fields import Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import BodyConditions, Conditions, ThrusterConditions
from rans.scenario import draws, scenarios

N = 0.001027
"""rad/s, AFRL's orbit."""
RADIUS = (EARTH / N**2) ** (1 / 3)
ORBIT = 2 * math.pi / N


def test_a_craft_on_the_targets_orbit_stays_at_its_angle_behind() -> None:
    angle = 0.01
    p = RADIUS * np.array([[math.cos(angle) - 1, -math.sin(angle), 0]])
    times = [0.3 * ORBIT, ORBIT]
    positions, velocities = relative_motion(N, p, np.zeros((1, 3)), times)
    # 1e-6 m on 65 km after an orbit, as the module says; a speed of a micrometre a second is n times that and more.
    np.testing.assert_allclose(positions, [p, p], atol=1e-5)
    np.testing.assert_allclose(velocities, 0, atol=1e-7)


def test_a_circular_orbit_above_moves_by_keplers_third_law() -> None:
    # 50 km above: the angle falls behind by the difference of both mean motions.
    above = RADIUS + 5e4
    slower = math.sqrt(EARTH / above**3)
    time = 4000.0
    p, v = np.array([[5e4, 0, 0]]), np.array([[0, (slower - N) * above, 0]])
    positions, _ = relative_motion(N, p, v, [time])
    angle = (slower - N) * time
    expected = [above * math.cos(angle) - RADIUS, above * math.sin(angle), 0]
    np.testing.assert_allclose(positions[0, 0], expected, atol=1e-5)


def test_energy_and_momentum_of_coasts_are_conserved() -> None:
    rng = np.random.default_rng(3)
    p, v = rng.uniform(-800, 800, (16, 3)), rng.uniform(-1, 1, (16, 3))
    times = np.linspace(1000, 2 * ORBIT, 5)
    positions, velocities = relative_motion(N, p, v, [1e-9, *times])
    # In axes that rotate with the target: conserved quantities are of the inertial position and velocity.
    r = positions + np.array([RADIUS, 0, 0])
    rate = velocities + np.cross([0, 0, N], r)
    energy = 0.5 * (rate**2).sum(-1) - EARTH / np.linalg.norm(r, axis=-1)
    momentum = np.cross(r, rate)[..., 2]
    # Relative rounding of sums of 5e7 m^2/s^2 and 5e10 m^2/s, a few digits above double precision.
    np.testing.assert_allclose(energy, np.broadcast_to(energy[0], energy.shape), rtol=1e-13)
    np.testing.assert_allclose(momentum, np.broadcast_to(momentum[0], momentum.shape), rtol=1e-13)


def test_a_push_radially_outwards_acts_as_hand_computed() -> None:
    # At short times only a t^2 / 2 and the turn of the frame, 2 n x the velocity: y = -n a t^3 / 3.
    a, t = 0.02, 10.0
    positions, velocities = relative_motion(
        N, np.zeros((1, 3)), np.zeros((1, 3)), [t], np.array([[a, 0, 0]])
    )
    # The next terms are n^2 t^2, 1e-4, of these.
    assert positions[0, 0, 0] == pytest.approx(a * t**2 / 2, rel=1e-4)
    assert positions[0, 0, 1] == pytest.approx(-N * a * t**3 / 3, rel=1e-4)
    assert velocities[0, 0, 0] == pytest.approx(a * t, rel=1e-4)


def test_linearised_orbits_differ_by_the_square_of_the_distance() -> None:
    # What Clohessy and Wiltshire leave out is quadratic in distance over radius.
    rng = np.random.default_rng(4)
    p = rng.normal(size=(8, 3))
    v = rng.normal(size=(8, 3)) * N
    gaps = []
    for scale in (10.0, 20.0):
        exact, _ = relative_motion(N, p * scale, v * scale, [3000.0])
        linear, _ = ClohessyWiltshire(N).carry(Vec3(*(p * scale).T), Vec3(*(v * scale).T), 3000.0)
        gaps.append(np.linalg.norm(exact[0] - np.stack(linear.columns(), axis=1), axis=1))
    # Cubic terms are 20 m over 7,000 km of them.
    np.testing.assert_allclose(gaps[1] / gaps[0], 4, rtol=1e-3)


@pytest.mark.slow
def test_dock_is_won_in_two_body_gravity() -> None:
    craft, task = load_spacecraft("afrl-deputy"), Dock(deadline=(600.0, 600.0)).for_evaluation()
    starts = scenarios(task, craft, 5, 2)
    timing = replace(task.timing, episode_steps=60)
    flight, other = (
        fly(craft, task, MissionGuidance(craft, task), starts, timing, mover)
        for mover in (None, TwoBodyMover(craft, timing, N))
    )
    assert other.done is not None
    assert other.done.all()
    # Half way, before they correct the last of it, other equations differ by 1 mm (150 m in 300 s), and the same
    # equations would differ by nothing.
    gaps = np.stack((flight.states.p - other.states.p).columns())[:, :30]
    assert 1e-6 < np.abs(gaps).max() < 0.05


def test_craft_that_turn_are_refused() -> None:
    with pytest.raises(ConfigError, match="torque"):
        TwoBodyMover(load_spacecraft("astrobee-iss"), Timing(), N)


@pytest.mark.parametrize(
    "conditions",
    [
        Conditions(thrusters=ThrusterConditions(noise=0.1)),
        Conditions(thrusters=ThrusterConditions(misalignment=0.01)),
        Conditions(thrusters=ThrusterConditions(thrust=(0.9, 1.1))),
        Conditions(body=BodyConditions(mass=1.1)),
    ],
    ids=["noise of thrusts", "misaligned thrusters", "thrust", "mass"],
)
def test_conditions_of_the_craft_are_refused(conditions: Conditions) -> None:
    craft, task = load_spacecraft("afrl-deputy"), Dock()
    starts = scenarios(task, craft, 5, 2)
    mover = TwoBodyMover(craft, task.timing, N)
    pilot = MissionGuidance(craft, task)
    with pytest.raises(ConfigError, match="nominal conditions only"):
        fly(
            craft,
            task,
            pilot,
            starts,
            replace(task.timing, episode_steps=1),
            mover,
            conditions=conditions,
            draws=draws(5, 2),
        )


def test_targets_on_ellipses_differ_from_linear_motion_by_the_square_of_the_distance() -> None:
    rng = np.random.default_rng(4)
    p = rng.normal(size=(5, 3))
    v = rng.normal(size=(5, 3)) * N
    true = np.array([-2.0, -0.5, 0.3, 1.0, 3.0])
    drift = EllipticOrbit(N, 0.4, mean_anomaly(true, 0.4))
    gaps = []
    for scale in (10.0, 20.0):
        exact, _ = relative_motion(
            N, p * scale, v * scale, [3000.0], eccentricity=0.4, true_anomaly=true
        )
        linear, _ = drift.carry(Vec3(*(p * scale).T), Vec3(*(v * scale).T), 3000.0)
        gaps.append(np.linalg.norm(exact[0] - np.stack(linear.columns(), axis=1), axis=1))
    # At most 7 cm of some hundred metres; cubic terms are 100 m over 7,000 km of them.
    assert gaps[1].max() < 0.5
    np.testing.assert_allclose(gaps[1] / gaps[0], 4, rtol=1e-3)


def test_the_oblate_earth_turns_orbital_planes_at_the_rate_of_textbooks() -> None:
    """The mean rate of the node is -1.5 n J2 (R / a)^2 cos i, to the first order in J2."""
    tilt = 0.9
    latitude = np.zeros(1)
    perturbed = Perturbations(tilt, latitude)
    r = RADIUS * np.array([[1.0, 0.0, 0.0]])
    rate = RADIUS * N * np.array([[0.0, math.cos(tilt), math.sin(tilt)]])

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        r, v = y.reshape(2, 1, 3)
        pull = -EARTH / RADIUS**3 * r * (RADIUS / np.linalg.norm(r)) ** 3
        return np.concatenate([v, pull + perturbed.acceleration(r, v, 0.0)]).ravel()

    flown = solve_ivp(slope, (0, 2 * ORBIT), np.concatenate([r, rate]).ravel(), rtol=1e-10)
    r, v = flown.y[:, -1].reshape(2, 3)
    normal = np.cross(r, v)
    node = math.atan2(normal[0], -normal[1])
    expected = -1.5 * J2 * (6_378_137.0 / RADIUS) ** 2 * math.cos(tilt) * 4 * math.pi
    # Beside it are terms of the second order, and the orbit's mean size differs from that at the start.
    assert node == pytest.approx(expected, rel=1e-2)


def test_without_perturbations_both_integrations_are_the_same() -> None:
    rng = np.random.default_rng(5)
    p, v = rng.normal(size=(4, 3)) * 60, rng.normal(size=(4, 3)) * 60 * N
    latitude = rng.uniform(0, 6, 4)
    push = rng.normal(size=(4, 3)) * 1e-4
    alone = perturbed_motion(N, p, v, [2000.0], Perturbations(0.9, latitude, oblate=False), push)
    plain = relative_motion(N, p, v, [2000.0], push)
    np.testing.assert_allclose(alone[0], plain[0], atol=1e-7)
    np.testing.assert_allclose(alone[1], plain[1], atol=1e-10)
    # A craft at the target that feels what the target feels stays there; with more drag it falls behind and below.
    zero = np.zeros((4, 3))
    both = Perturbations(0.9, latitude, True, 0.02, 0.02)
    np.testing.assert_allclose(
        perturbed_motion(N, zero, zero, [2000.0], both)[0], [zero], atol=1e-9
    )


def test_drag_slows_a_craft_as_worked_out_by_hand() -> None:
    """Over the equator at 400 km: a = density c (v - R omega)^2 / 2, and y = -a t^2 / 2 at short times."""
    radius = 6_778_137.0
    n = math.sqrt(EARTH / radius**3)
    dragged = Perturbations(0.0, np.zeros(1), oblate=False, craft_drag=0.05)
    zero = np.zeros((1, 3))
    time = 30.0
    moved = perturbed_motion(n, zero, zero, [time], dragged)[0][0, 0]
    speed = n * radius - 7.292115e-5 * radius
    # n t is 0.03, and its square is neglected.
    assert moved[1] == pytest.approx(-0.25 * 3.725e-12 * 0.05 * speed**2 * time**2, rel=2e-3)
    assert density(np.array([2e6]))[0] == 0.0
