"""NASA's JEOD: two bodies that attach where they meet, fly on as one, and detach."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rans.model.body import Body
from rans.model.contact import join_at_contact, part
from rans.model.dynamics import SpatialState, Wrench, advance
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from validation.judges.judge import Judge, Largest, Row
from validation.study.checks import Check

_CENTRE = (5.0, 0.0, 0.0)
"""Centre of mass of each vehicle in its structure, m."""
_ATTACH, _DETACH = 10.0, 20.0
"""Times of both events, s."""
MEETING = {
    "joined": {
        10.0: ((1.6666666666666667, 10.0, 0.0), (0.0, 1.0 / 3.0, 0.0)),
        19.5: ((1.666666666666667, 13.16666666666716, 0.0), (0.0, 0.3333333333333333, 0.0)),
    },
    "veh1": {
        20.0: (
            (-4.747938319005819, 15.14917675230756, 0.0),
            (0.05009223224755069, 0.5102879536277467, 0.0),
        ),
        25.0: ((-4.497477157767872, 17.70061652044633, 0.0), None),
        28.0: ((-4.347200461025103, 19.23148038132959, 0.0), None),
    },
    "veh2": {
        20.0: (
            (4.873969159502909, 12.42541162384699, 0.0),
            (-0.02504611612377535, 0.2448560231861266, 0.0),
        ),
        25.0: ((4.748738578884158, 13.649691739778, 0.0), None),
        28.0: ((4.673600230512907, 14.38425980933661, 0.0), None),
    },
}
"""Position, m, and velocity, m/s, of centres of mass at times, s; those at 10 s follow from momentum by hand."""
SPIN = -8.0 / 290.0
"""Spin about z while joined and after, rad/s."""
TURNED = (0.9786731483070237, 0.2054236324837498)
"""Scalar and z of `Q_parent_this` of both at 25 s: from inertial to body axes."""
ATTACHED = Judge(
    "NASA JEOD",
    "nasa/jeod, models/dynamics/dyn_body/verif/SIM_verif_attach_detach; rows of simnaut/astrodyn "
    "crates/astrodyn_verif_jeod/test_data/kinematic_propagation_simple_kinematic_propagation_state.csv",
    "6550cf4edbfc556c5765508b238a226eebab4a78",
    "It composes trees of bodies and integrates structure points in axes that do not turn; ours is momentum at one "
    "instant.",
)


def vehicles() -> tuple[Spacecraft, Spacecraft]:
    """The two vehicles; their thrusters are those of the free flyer and do nothing."""
    base = replace(load_spacecraft("free-flyer"), centre_of_mass=_CENTRE)
    first, second = (
        replace(
            base,
            name=name,
            mass=mass,
            inertia=((moment, 0.0, 0.0), (0.0, moment, 0.0), (0.0, 0.0, moment)),
        )
        for name, mass, moment in (("veh1", 1.0, 10.0), ("veh2", 2.0, 20.0))
    )
    return first, second


def flown() -> dict[str, dict[float, SpatialState]]:
    """States of the joined craft, of veh1 and of veh2 at the times of `MEETING`."""
    first, second = vehicles()
    half = -1.0
    one = SpatialState(
        Vec3(-5.0, 0.0, 0.0), Quat(1.0, 0.0, 0.0, 0.0), Vec3(0.0, 1.0, 0.0), Vec3(0.0, 0.0, 0.0)
    )
    # -2 rad about z at the start.
    two = SpatialState(
        Vec3(5.0, 10.0, 0.0),
        Quat(math.cos(half), 0.0, 0.0, math.sin(half)),
        Vec3(0.0, 0.0, 0.0),
        Vec3(0.0, 0.0, 0.2),
    )
    one, two = _coast(first, one, _ATTACH), _coast(second, two, _ATTACH)
    craft, joined = join_at_contact(first, second, one, two)
    states: dict[str, dict[float, SpatialState]] = {"joined": {_ATTACH: joined}}
    states["joined"][19.5] = _coast(craft, joined, 9.5)
    together = _coast(craft, joined, _DETACH - _ATTACH)
    parted = part(first, second, (10.0, 0.0, 0.0), 0.0, together)
    for vehicle, name, state in zip((first, second), ("veh1", "veh2"), parted, strict=True):
        states[name] = {time: _coast(vehicle, state, time - _DETACH) for time in MEETING[name]}
    return states


def rows() -> Iterator[Row]:
    """One row."""
    largest = Largest()
    states = flown()
    for name, figures in MEETING.items():
        for time, (p, v) in figures.items():
            state = states[name][time]
            largest.add("position", _relative(state.p, p))
            if v is not None:
                largest.add("velocity", _relative(state.v, v))
            largest.add("spin", abs(state.w.z / SPIN - 1.0))
    for name in ("veh1", "veh2"):
        q = states[name][25.0].attitude
        largest.add("attitude", max(abs(q.w - TURNED[0]), abs(-q.z - TURNED[1])))
    reason = "Digits of the figures; JEOD's steps of 0.1 s leave 1e-13 of them."
    checks = tuple(
        Check(name, value, 1e-12, f"of the {name}", reason)
        for name, value in largest.values.items()
    )
    yield Row(
        ATTACHED,
        "JEOD attach and detach",
        "two bodies meet at 10 s and part at 20 s",
        "RUN_simple_attach_detach/log_vehicle_State.csv",
        checks,
        "1.7e-9 m of a port to Rust (simnaut/astrodyn)",
    )


def _relative(own: Vec3, other: tuple[float, ...]) -> float:
    """Difference of vectors over the length of the other."""
    return float(np.linalg.norm(np.subtract(own.columns(), other)) / np.linalg.norm(other))


def _coast(craft: Spacecraft, state: SpatialState, duration: float) -> SpatialState:
    zero = Vec3(0.0, 0.0, 0.0)
    if duration == 0.0:
        return state
    return advance(state, Wrench(zero, zero), Body.of(craft), duration, 10).normalised()
