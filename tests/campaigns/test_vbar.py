"""The agent for V-BAR flies from V-BAR's public descriptions. SciPy moves it here: V-BAR is no dependency."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from campaigns.vbar import Guidance, in_time
from tests.support.clohessy_wiltshire import transition

N = 0.0011067834463349404
"""Mean motion at 500 km, rad/s, as V-BAR gives it."""


def flown(view: Any, state: np.ndarray, steps: int, noise: float = 0.0) -> np.ndarray:
    """States (steps + 1, 6) at the beginnings of control periods, with the equations of motion written here."""
    step = transition(N, view.dt)
    random = np.random.default_rng(3)
    agent = Guidance()
    agent.reset(view)
    states = [state]
    for k in range(steps):
        errors = noise * np.repeat([1.0, 1e-3], 3) * random.standard_normal(6)
        command = agent.act(states[-1] + errors, {"time_s": k * view.dt})
        assert np.abs(command).max() <= 1.0
        full = np.concatenate([states[-1], command * view.max_accel])
        states.append((step @ full)[:6])
    return np.array(states)


def described(task: str, dt: float, constraints: Any, scenario: str = "vbar:x", **goal: Any) -> Any:
    """What V-BAR tells agents of a scenario."""
    return SimpleNamespace(
        scenario_id=scenario,
        dt=dt,
        n=N,
        max_accel=0.02,
        max_steps=360,
        goal={"task": task, "target": {"mode": "passive"}, **goal},
        constraints=constraints,
    )


def test_the_corridor_of_the_berthing_box_is_kept_to_its_end() -> None:
    """The apex of the corridor of 10 degrees is 0.5 m / tan(10 degrees) behind the box 15 m below the target."""
    view = described("berth", 10.0, (), hold_point=(-15.0, 0.0, 0.0))
    states = flown(view, np.array([-70.0, 4.0, -4.0, 0.01, -0.01, 0.01]), 160)
    behind = -15.0 + 0.5 / np.tan(np.radians(10.0)) - states[:, 0]
    beside = np.linalg.norm(states[:, 1:3], axis=1)
    assert (np.arctan2(beside, behind) < np.radians(10.0)).all()
    assert np.linalg.norm(states[-1, :3] - [-15.0, 0.0, 0.0]) < 0.1
    assert np.linalg.norm(states[-1, 3:]) < 0.005


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_contact_with_a_port_is_slow_and_centred(noise: float) -> None:
    """From inside the corridor, with and without the noise of V-BAR's track nav1 (1 m and 1 mm/s)."""
    cone = {"type": "approach_cone", "half_angle": 0.1745, "active_range": 200.0}
    goal = {"port": (0.0, -2.0, 0.0), "port_axis": (0.0, -1.0, 0.0)}
    name = "vbar:docking:cw:box:dv:v2:nav1" if noise else "vbar:docking"
    view = described("dock", 5.0, (cone,), name, axial_speed_window=(0.05, 0.1), **goal)
    states = flown(view, np.array([1.0, -152.0, 1.0, 0.0, 0.0, 0.0]), 300, noise)
    contact = states[np.flatnonzero(states[:, 1] > -2.0)[0]]
    # V-BAR's reception is 0.1 m and 3 cm/s; with noise the estimate of 300 readings is good to 6 cm an axis.
    assert np.linalg.norm(contact[[0, 2]]) < (0.25 if noise else 0.01)
    assert np.linalg.norm(contact[[3, 5]]) < 0.03
    assert 0.05 < contact[4] < 0.1


def test_a_burn_onto_the_ellipse_that_is_longer_than_a_period_goes_on() -> None:
    """A start whose arrival takes 0.207 m/s, more than a period of 10 s gives: it must not drift away for that."""
    sun = (0.7552398759546022, -0.4122823240536014, 0.5095449097391106)
    keep_out = {"type": "keep_out", "radius": 10.0}
    view = described("inspect", 10.0, (keep_out,), max_range=200.0, sun_direction=sun)
    start = np.array([-117.498, 26.040, -3.242, 0.006, 0.0102, -0.0327])
    states = flown(view, start, 1140)
    # An orbit lasts 568 periods, and within 200 m V-BAR counts what a craft sees.
    assert np.linalg.norm(states[-568:, :3], axis=1).max() < 200.0


@pytest.mark.parametrize("phase", np.radians([77.0, 80.0, 83.0, 90.0]))
def test_a_turning_cone_is_entered_only_with_time_to_hold(phase: float) -> None:
    """V-BAR's grapple: a cone of 10 degrees turns over the hold point, and a hold of 120 s counts.

    With the first three phases the craft comes when the cone is there already, and would pass too soon.
    """
    rate, half_angle, reach = -0.001092457576945965, np.radians(10.0), 15.24
    gates = (
        (609.6, 0.9144),
        (152.4, 0.1524),
        (60.96, 0.06096),
        (36.576, 0.06096),
        (30.48, 0.03048),
    )
    view = described(
        "hold",
        10.0,
        (
            {"type": "approach_cone", "half_angle": half_angle, "active_range": reach},
            {"type": "gate_table", "gates": gates},
        ),
        hold_point=(-10.668, 0.0, 0.0),
        capture_radius=1.0,
        hold_time=120.0,
    )
    view.goal["target"] = {"mode": "inertial", "phase": phase, "rate": rate}
    states = flown(view, np.array([-60.0, 1.0, 0.0, 0.0, 0.0, 0.0]), 1000)
    turn = np.pi + phase + rate * view.dt * np.arange(len(states))
    axis = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    p = states[:, :3]
    along = (p * axis).sum(axis=1)
    beside = np.linalg.norm(p - along[:, None] * axis, axis=1)
    near = np.linalg.norm(p, axis=1) < reach
    held = np.linalg.norm(p - [-10.668, 0.0, 0.0], axis=1) < 1.0
    held &= np.linalg.norm(states[:, 3:], axis=1) < 0.01
    runs = np.convolve(held, np.ones(13), "valid")
    assert runs.max() == 13.0
    # Until the hold has lasted: V-BAR's episode ends then.
    until = int(np.argmax(runs == 13.0)) + 13
    assert (np.arctan2(beside, along) < half_angle)[:until][near[:until]].all()


def test_it_waits_only_for_ports_that_turn_and_for_readings_to_average() -> None:
    """The light near a port can pass while a craft waits for nothing."""
    cone = {"type": "approach_cone", "half_angle": 0.1745, "active_range": 50.0}
    goal = {"port": (0.0, -2.0, 0.0), "port_axis": (0.0, -1.0, 0.0)}

    def waits(scenario: str, **target: float) -> bool:
        view = described("dock", 5.0, (cone,), scenario, axial_speed_window=(0.05, 0.1), **goal)
        view.goal["target"] = target
        state = np.array([0.0, -300.0, 0.0, 0.0, 0.0, 0.0])
        _, second, *_ = Guidance().route(view, state)
        # The leg after the transfer ends at a time only if it is a wait.
        return second.over(state, 1e5)

    assert not waits("vbar:docking")
    assert waits("vbar:inertial-target", rate=-N)
    assert waits("vbar:docking:cw:box:dv:v2:nav1")


def test_a_departing_craft_never_comes_back() -> None:
    """It leaves along the axis, and a coast of two orbits keeps 300 m away; V-BAR asks for 30 m."""
    cone = {"type": "approach_cone", "half_angle": 0.1745, "active_range": 122.0}
    goal = {"port": (0.0, 30.0, 0.0), "port_axis": (0.0, 1.0, 0.0), "clear_range": 610.0}
    view = described("depart", 10.0, (cone,), **goal)
    states = flown(view, np.array([0.0, 30.2, 0.0, 0.0, 0.05, 0.0]), 330)
    away = np.linalg.norm(states[:, :3], axis=1)
    assert away.min() > 30.0
    assert away[-1] > 610.0
    x, y, _, vx, vy, _ = states[-1]
    times = np.linspace(0.0, 4.0 * np.pi / N, 2000)
    s, c = np.sin(N * times), np.cos(N * times)
    # The closed form of the in-plane motion.
    across = (4.0 - 3.0 * c) * x + s * vx / N + 2.0 * (1.0 - c) * vy / N
    along = (
        y + 6.0 * (s - N * times) * x - 2.0 * (1.0 - c) * vx / N + (4.0 * s / N - 3.0 * times) * vy
    )
    assert np.hypot(across, along).min() > 300.0


def test_a_transfer_hurries_only_where_the_light_would_pass_and_not_come_back() -> None:
    """V-BAR's window lasts 900 s and returns after an orbit of 5,677 s; an episode ends after 7,500 s."""

    def opens(begin: float) -> Any:
        return lambda t: (t - begin) % 5677.0 < 900.0

    # It returns at 6,677 s; or at 7,577 s, too late: the way in begins before 2,800, or before 2,300 s.
    assert in_time(opens(1000.0), 7500.0) == 2200.0
    assert in_time(opens(1900.0), 7500.0) == 2200.0
    assert in_time(opens(1600.0), 7200.0) == 1800.0
    assert in_time(lambda t: True, 7500.0) == 2200.0
    assert in_time(lambda t: False, 7500.0) == 2200.0
