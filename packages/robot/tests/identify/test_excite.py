"""Commands that tell parameters apart."""

from __future__ import annotations

import numpy as np
import pytest
from rans_robot.identify.excite import Excitation

from rans.model.spacecraft_file import load_spacecraft

pytest.importorskip("rosbags")


def test_regressors_are_derivatives_of_the_acceleration() -> None:
    """Newton and Euler by hand, with each parameter moved by a little."""
    craft = load_spacecraft("free-flyer")
    columns = np.array(craft.wrench_map)
    inertia = np.array(craft.inertia)
    n = len(columns)
    make = Excitation(craft, 0.2, 3.0, 0)
    random = np.random.default_rng(1)
    command = (random.random(n) < 0.3).astype(float)
    rotation = np.linalg.qr(random.normal(size=(3, 3)))[0]

    def acceleration(parameters: np.ndarray) -> np.ndarray:
        gain = 1.0 + 0.3 * parameters[:n]
        wrench = (command * gain) @ columns
        tensor = inertia.copy()
        entries = iter(parameters[n : n + 6])
        for i in range(3):
            for j in range(i, 3):
                change = 0.3 * np.sqrt(inertia[i, i] * inertia[j, j]) * next(entries)
                tensor[i, j] += change
                if i != j:
                    tensor[j, i] += change
        centre = 0.03 * parameters[n + 6 : n + 9]
        torque = wrench[3:] - np.cross(centre, wrench[:3])
        size = 0.5 * np.max(np.linalg.norm(columns[:, :3], axis=1))
        lever = 0.5 * np.max(np.linalg.norm(columns[:, 3:], axis=1))
        force = wrench[:3] + rotation.T @ (size * parameters[n + 9 : n + 12])
        torque = torque + rotation.T @ (lever * parameters[n + 12 :])
        return np.concatenate([force / craft.mass, np.linalg.solve(tensor, torque)])

    (rows,) = make.regressors(command[None], rotation)
    assert rows.shape == (6, n + 15)
    for k in range(n + 15):
        step = np.zeros(n + 15)
        step[k] = 1e-6
        slope = (acceleration(step) - acceleration(-step)) / 2e-6
        assert rows[:, k] == pytest.approx(slope, abs=1e-7)
