"""The oracles themselves, on cases that can be worked out on paper."""

from dataclasses import replace

import numpy as np
import pytest

from rans.model.fields import Vec3
from rans.model.spacecraft_file import load_spacecraft
from validation.study import oracles
from validation.study.oracles import spinning_up, tumbling
from validation.study.sampling import gap, random_states


def test_the_numerical_oracle_agrees_with_the_closed_form():
    """Five periods of a constant wrench: 1e-13 a step of some ten steps a period, of some metres."""
    start = random_states(2, 5, 4)
    push = np.array([0.3 + 0.1j, -1.0j, 0.5, 0.2 - 0.7j])
    spin_up = np.array([0.2, -1.5, 0.7, -0.4])
    craft = load_spacecraft("floating-platform")
    force = craft.mass * np.stack([push.real, push.imag, 0.0 * push.real], axis=1)
    torque = craft.inertia[2][2] * np.stack([0.0 * spin_up, 0.0 * spin_up, spin_up], axis=1)
    found = start
    for _ in range(5):
        found = oracles._solve_planar(craft, found, force, torque, 0.2)
    assert max(gap(found, spinning_up(start, push, spin_up, 1.0)).values()) < 1e-11


def test_the_numerical_oracle_in_space_agrees_with_the_top():
    """Without thrust: the spin of the closed form, and of all else what does not change."""
    moments = np.array([0.2, 0.3, 0.45])
    craft = replace(load_spacecraft("free-flyer"), inertia=tuple(map(tuple, np.diag(moments))))
    states = random_states(3, 5, 4)
    least = np.array([0.9, 0.2, 0.5, 0.7])
    largest = np.array([0.3, 0.9, 0.5, 0.1])
    start = replace(states, w=Vec3(least, 0.0 * least, largest))
    found = oracles._solve_spatial(craft, start, np.zeros((4, 3)), np.zeros((4, 3)), 2.0)
    expected = tumbling(moments, least, largest, 2.0)
    assert np.array(found.w.columns()) == pytest.approx(expected, abs=1e-11)
    for way, speed, place in zip(
        found.p.columns(), start.v.columns(), start.p.columns(), strict=True
    ):
        assert way == pytest.approx(place + 2.0 * speed, abs=1e-12)
    before, after = (
        state.attitude.rotate(Vec3(*(moments[:, None] * state.w.columns()))).columns()
        for state in (start, found)
    )
    assert np.array(after) == pytest.approx(np.array(before), abs=1e-11)


@pytest.mark.slow
def test_the_worst_top_is_named(monkeypatch):
    """One of five spins a microradian per second off: the largest counts, whatever the others do."""
    true = oracles.tumbling

    def off(*arguments):
        spin = true(*arguments)
        spin[1, 3] += 1e-6
        return spin

    monkeypatch.setattr(oracles, "tumbling", off)
    [check] = oracles._top_checks(load_spacecraft("free-flyer"), 1, 5)
    assert (check.worst, check.passed) == ("state 3", False)
    assert check.value == pytest.approx(1e-6, rel=1e-3)
