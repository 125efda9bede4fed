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
from rans_missions.two_body import Gravity, TwoBodyMover, on_ellipse

from rans.errors import ConfigError
from rans.flight import fly
from rans.model.fields import Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import BodyConditions, Conditions, ThrusterConditions
from rans.scenario import draws, scenarios

N = 0.001027
"""rad/s, AFRL's orbit."""
RADIUS = (EARTH / N**2) ** (1 / 3)
ORBIT = 2 * math.pi / N


def circle(count: int) -> tuple[np.ndarray, np.ndarray]:
    return on_ellipse(N, 0.0, np.zeros(count))


def test_a_circular_orbit_above_moves_by_keplers_third_law() -> None:
    # 50 km above: the angle falls behind by the difference of both mean motions.
    above = RADIUS + 5e4
    slower = math.sqrt(EARTH / above**3)
    time = 4000.0
    p, v = np.array([[5e4, 0, 0]]), np.array([[0, (slower - N) * above, 0]])
    positions, _ = Gravity().motion(circle(1), p, v, [time])
    angle = (slower - N) * time
    expected = [above * math.cos(angle) - RADIUS, above * math.sin(angle), 0]
    np.testing.assert_allclose(positions[0, 0], expected, atol=1e-4)


def test_energy_and_momentum_of_coasts_are_conserved() -> None:
    rng = np.random.default_rng(3)
    p, v = rng.uniform(-800, 800, (16, 3)), rng.uniform(-1, 1, (16, 3))
    times = np.linspace(1000, 2 * ORBIT, 5)
    positions, velocities = Gravity().motion(circle(16), p, v, [1e-9, *times])
    # In axes that rotate with the target: conserved quantities are of the inertial position and velocity.
    r = positions + np.array([RADIUS, 0, 0])
    rate = velocities + np.cross([0, 0, N], r)
    energy = 0.5 * (rate**2).sum(-1) - EARTH / np.linalg.norm(r, axis=-1)
    momentum = np.cross(r, rate)[..., 2]
    # Relative rounding of sums of 5e7 m^2/s^2 and 5e10 m^2/s, and the integrator's 1e-12 of the target's orbit.
    np.testing.assert_allclose(energy, np.broadcast_to(energy[0], energy.shape), rtol=1e-11)
    np.testing.assert_allclose(momentum, np.broadcast_to(momentum[0], momentum.shape), rtol=1e-11)


def test_a_push_radially_outwards_acts_as_hand_computed() -> None:
    # At short times only a t^2 / 2 and the turn of the frame, 2 n x the velocity: y = -n a t^3 / 3.
    a, t = 0.02, 10.0
    still = np.zeros((1, 3))
    positions, velocities = Gravity().motion(circle(1), still, still, [t], np.array([[a, 0, 0]]))
    # The next terms are n^2 t^2, 1e-4, of these.
    assert positions[0, 0, 0] == pytest.approx(a * t**2 / 2, rel=1e-4)
    assert positions[0, 0, 1] == pytest.approx(-N * a * t**3 / 3, rel=1e-4)
    assert velocities[0, 0, 0] == pytest.approx(a * t, rel=1e-4)


def test_linear_motion_differs_by_the_square_of_the_distance() -> None:
    """On ellipses, where the target is at another place for each craft."""
    rng = np.random.default_rng(4)
    p = rng.normal(size=(5, 3))
    v = rng.normal(size=(5, 3)) * N
    true = np.array([-2.0, -0.5, 0.3, 1.0, 3.0])
    drift = EllipticOrbit(N, 0.4, mean_anomaly(true, 0.4))
    gaps = []
    for scale in (10.0, 20.0):
        exact, _ = Gravity().motion(on_ellipse(N, 0.4, true), p * scale, v * scale, [3000.0])
        linear, _ = drift.carry(Vec3(*(p * scale).T), Vec3(*(v * scale).T), 3000.0)
        gaps.append(np.linalg.norm(exact[0] - np.stack(linear.columns(), axis=1), axis=1))
    # At most 7 cm of some hundred metres; cubic terms are 100 m over 7,000 km of them.
    assert gaps[1].max() < 0.5
    np.testing.assert_allclose(gaps[1] / gaps[0], 4, rtol=1e-3)


@pytest.mark.parametrize(
    "conditions",
    [
        Conditions(thrusters=ThrusterConditions(noise=0.1)),
        Conditions(body=BodyConditions(mass=1.1)),
    ],
)
def test_what_it_does_not_move_is_refused(conditions: Conditions) -> None:
    craft, task = load_spacecraft("afrl-deputy"), Dock()
    starts = scenarios(task, craft, 5, 2)
    timing = replace(task.timing, episode_steps=1)
    mover = TwoBodyMover(craft, task.timing, N)
    pilot = MissionGuidance(craft, task)
    with pytest.raises(ConfigError, match="nominal conditions only"):
        fly(craft, task, pilot, starts, timing, mover, conditions=conditions, draws=draws(5, 2))
    with pytest.raises(ConfigError, match="torque"):
        TwoBodyMover(load_spacecraft("astrobee-iss"), Timing(), N)
