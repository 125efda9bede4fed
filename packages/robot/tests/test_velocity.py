"""Velocities from poses alone."""

import numpy as np
import pytest
from rans_robot.frames import quaternion_of
from rans_robot.velocity import VelocityFilter

pytest.importorskip("rosbags")
pytest.importorskip("mcap")


def test_velocities_from_poses_settle_on_the_truth():
    """A body that moves steadily and turns, measured with noise at irregular times."""
    random = np.random.default_rng(0)
    velocity = np.array([0.2, -0.1, 0.0])
    filtered = VelocityFilter((0.05, 0.2), (0.001, 0.002))
    motion = None
    time = 0
    for _ in range(400):
        time += int(random.uniform(5e6, 15e6))
        seconds = time * 1e-9
        position = velocity * seconds + random.normal(0, 0.001, 3)
        attitude = quaternion_of(0.5 * seconds + random.normal(0, 0.002))
        motion = filtered.update(time, position, attitude)
    assert motion is not None
    # Steady state of this filter at 100 poses a second: a velocity's variance is sqrt(2) q^1.5 r^0.5, where q is
    # the density of the acceleration, 0.05 m/s^2 for a second, and r that of the noise, 1 mm at 100 Hz.
    expected = np.sqrt(np.sqrt(2.0) * 0.05**1.5 * (0.001 * 0.1) ** 0.5)
    assert np.abs(motion.velocity - velocity).max() < 4.0 * expected
    assert motion.spin[2] == pytest.approx(0.5, abs=0.1)


def test_velocities_follow_a_push():
    """Within a fifth of a second of a thruster's opening, exactly measured."""
    filtered = VelocityFilter((0.2, 1.0), (0.001, 0.002))
    motion = None
    for k in range(300):
        seconds = k * 0.01
        pushed = max(0.0, seconds - 2.0)
        position = np.array([0.5 * 0.2 * pushed**2, 0.0, 0.0])
        motion = filtered.update(k * 10_000_000, position, quaternion_of(0.0))
    assert motion is not None
    assert motion.velocity[0] == pytest.approx(0.2 * 0.99, abs=0.2 * 0.2)
