"""Attitude on an orbit against NASA's JEOD, and a tumbling body against five simulators of NASA.

The figures are typed from logs of NASA's simulation environment JEOD, repository nasa/jeod (NASA Open Source
Agreement 1.3), commit 6550cf4edbfc556c5765508b238a226eebab4a78, `verif/SIM_dyncomp/SET_test_val/RUN_X` and
`SET_test_val_rh8/RUN_8B` (`log_state_ASCII.csv`). These are the exo-atmospheric check cases of NASA's Engineering
and Safety Center. JEOD integrates a craft in inertial axes, in steps of 1/32 s; RANS flies it in the Hill frame of
a target that moves on the same orbit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rans.model.body import Body
from rans.model.drift import Drift, EllipticOrbit
from rans.model.dynamics import SpatialState, Wrench, advance
from rans.model.fields import Quat, Vec3

MU = 3.986004415e14
"""Gravitational parameter of these runs, m^3/s^2."""
TURN = -0.001134454274550824
"""Spin about body y with which a craft of these runs turns with the orbit, rad/s."""
START = (-4292653.41, 955168.47, 5139356.57), (109.649663, -7527.72649, 1484.521489)
"""Position, m, and velocity, m/s, at the start of the orbit called typical."""
POINTS = {
    1680: (
        (1510652.232246502, -6565276.754211916, -467211.0082228658),
        (4564.997214139488, 1481.953784717817, -6003.288980269067),
    ),
    1980: (
        (2766560.156937522, -5750517.961578787, -2206472.840108016),
        (3726.211299906233, 3897.092875503709, -5478.951520229162),
    ),
    14400: (
        (3337196.360802487, 3294360.191922436, -4864770.053582193),
        (-3059.506377849742, 6631.336150252283, 2381.559008977479),
    ),
    28800: (
        (-1024262.411095882, -6151093.565368023, 2599975.06217899),
        (4736.659484718068, -3000.74587812336, -5251.712385533817),
    ),
}
"""The same at later times, s, as logged."""
SPHERE = np.diag([0.4, 0.4, 0.4]), 1.0
STATION = (
    np.array(
        [
            [1.02e8, -6.96e6, -5.48e6],
            [-6.96e6, 0.91e8, 5.90e5],
            [-5.48e6, 5.90e5, 1.64e8],
        ]
    ),
    4e5,
)
"""Inertia, kg m^2, and mass, kg."""
ATTITUDE = (0.2368106365237557, 0.7173117043670278, -0.6140880728910785, 0.2286492509067215)
"""Attitude at the start: scalar and vector of `Q_parent_this`, from inertial to body axes."""


@dataclass(frozen=True)
class Run:
    """Inertial rotation of a run as JEOD logged it."""

    body: tuple[np.ndarray, float]
    spin: tuple[float, float, float]
    """Spin at the start in body axes, rad/s."""
    pushed: bool
    """Whether a torque of 10 N m about x acts from 1,000 s to 2,000 s."""
    logged: dict[int, tuple[tuple[float, ...], tuple[float, ...]]]
    """Spin, rad/s, and `Q_parent_this` at times, s."""


RUNS = {
    "8A": Run(
        SPHERE,
        (0.0, 0.0, 0.0),
        False,
        {14400: ((0.0, 0.0, 0.0), ATTITUDE), 28800: ((0.0, 0.0, 0.0), ATTITUDE)},
    ),
    "8B": Run(
        SPHERE,
        (0.0, TURN, 0.0),
        False,
        {
            14400: (
                (0.0, TURN, 0.0),
                (0.5108830506516122, -0.004150354372849, 0.4149481261491996, -0.7528607678188246),
            ),
            28800: (
                (0.0, TURN, 0.0),
                (0.552485583208927, 0.7147471978842037, -0.3576913742098468, -0.2365438738983577),
            ),
        },
    ),
    "9A": Run(
        STATION,
        (0.0, 0.0, 0.0),
        True,
        {
            1680: (
                (6.71355430500277e-05, 5.082641325885736e-06, 2.273124116664723e-06),
                (0.2445365134149838, 0.7141289328107767, -0.6119178757380324, 0.2361742455934575),
            ),
            1980: (
                (9.675395191674015e-05, 7.267429174997243e-06, 3.350755518983668e-06),
                (0.2528278067247668, 0.7105924562067504, -0.6094956535243705, 0.2442365854324494),
            ),
            28800: (
                (9.751635347691358e-05, 8.882593782196596e-06, 1.53007486831241e-05),
                (0.7519599906623781, -0.1381383235762205, 0.01275190192580681, 0.6444465571324457),
            ),
        },
    ),
    # 9D has the same rotation as 9B: the force that it adds acts at the centre of mass.
    "9B": Run(
        STATION,
        (0.0, TURN, 0.0),
        True,
        {
            1680: (
                (-1.203961918930776e-05, -0.001126543557164252, -9.283029842033375e-05),
                (0.6285022016377276, 0.624194986722088, -0.137692887950199, -0.443177469751651),
            ),
            1980: (
                (-9.780689778191082e-06, -0.001123221755689028, -0.0001097798292757372),
                (0.6483827347535902, 0.5438618945375028, -0.02007799391243573, -0.5323635441162234),
            ),
            28800: (
                (-0.0007282187220568775, -0.0008332384627087039, -0.0002424925044840342),
                (0.3170011650039812, 0.5866170655406695, -0.376943289268734, -0.642887576857603),
            ),
        },
    ),
}


def _frame(p: tuple[float, ...], v: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Axes of the Hill frame as columns, from inertial position and velocity, and its angular velocity in them."""
    r, momentum = np.array(p), np.cross(p, v)
    out = r / np.linalg.norm(r)
    across = momentum / np.linalg.norm(momentum)
    axes = np.stack([out, np.cross(across, out), across], axis=1)
    return axes, np.array([0.0, 0.0, float(np.linalg.norm(momentum) / (r @ r))])


def _orbit(p: tuple[float, ...], v: tuple[float, ...]) -> EllipticOrbit:
    """The target's orbit, by the integrals of Kepler's motion."""
    r, u = np.array(p), np.array(v)
    radius = float(np.linalg.norm(r))
    size = 1.0 / (2.0 / radius - u @ u / MU)
    along = 1.0 - radius / size, r @ u / math.sqrt(MU * size)
    e, anomaly = math.hypot(*along), math.atan2(along[1], along[0])
    return EllipticOrbit(math.sqrt(MU / size**3), e, anomaly - along[1])


def _body_to_inertial(logged: tuple[float, ...]) -> Rotation:
    """JEOD's quaternion turns the other way, and its scalar comes first."""
    s, x, y, z = logged
    return Rotation.from_quat([-x, -y, -z, s])


def _flown(
    body: tuple[np.ndarray, float],
    attitude: Rotation,
    spin: np.ndarray,
    drift: Drift,
    pushes: list[tuple[float, float]],
) -> tuple[Rotation, np.ndarray]:
    """Attitude and spin relative to W after torques about x, N m, each for a period, s."""
    tensor, mass = body
    of_body = Body(mass, tuple(map(float, tensor[np.triu_indices(3)])))
    x, y, z, w = map(float, attitude.as_quat())
    zero = Vec3(0.0, 0.0, 0.0)
    state = SpatialState(zero, Quat(w, x, y, z), zero, Vec3(*map(float, spin)))
    for period, torque in pushes:
        wrench = Wrench(zero, Vec3(torque, 0.0, 0.0))
        state = advance(state, wrench, of_body, period, drift=drift).normalised()
        drift = drift.later(period)
    q = state.attitude
    return Rotation.from_quat([q.x, q.y, q.z, q.w]), np.array(state.w.columns())


def _apart(run: Run, until: int = 28800) -> Iterator[tuple[float, float]]:
    """Differences from JEOD at every logged time, in attitude, degrees, and spin, rad/s."""
    axes, rate = _frame(*START)
    attitude = Rotation.from_matrix(axes).inv() * _body_to_inertial(ATTITUDE)
    relative = np.array(run.spin) - attitude.inv().apply(rate)
    drift: Drift = _orbit(*START)
    now = 0
    for time, (spin, logged) in run.logged.items():
        if time > until:
            return
        pushes = []
        while now < time:
            period = 20.0 if now < 2040 else 60.0
            pushes.append((period, 10.0 * (run.pushed and 1000 <= now < 2000)))
            now += int(period)
        attitude, relative = _flown(run.body, attitude, relative, drift, pushes)
        drift = drift.later(sum(period for period, _ in pushes))
        # Back into inertial axes, from JEOD's own position and velocity.
        axes, rate = _frame(*POINTS[time])
        inertial = Rotation.from_matrix(axes) * attitude
        off = (inertial.inv() * _body_to_inertial(logged)).magnitude()
        yield math.degrees(off), float(np.abs(relative + attitude.inv().apply(rate) - spin).max())


@pytest.mark.parametrize("name", RUNS)
def test_attitude_on_an_orbit_is_that_of_jeod(name: str) -> None:
    for attitude, spin in _apart(RUNS[name]):
        # Sixteen digits of 33 rad in eight hours; the log has as many.
        assert attitude < 1e-9
        assert spin < 1e-15


def _no_turn(orbit: EllipticOrbit, t: float) -> Quat:
    return Quat(1.0, 0.0, 0.0, 0.0)


def _other_way(orbit: EllipticOrbit, t: float) -> Quat:
    return TRUE_TURN(orbit, t).inverse()


def _half(orbit: EllipticOrbit, t: float) -> Quat:
    return TRUE_TURN(orbit, 0.5 * t)


TRUE_TURN = EllipticOrbit.turn


@pytest.mark.parametrize("planted", [_no_turn, _other_way, _half])
@pytest.mark.parametrize("name", ["9A", "9B"])
def test_a_frame_that_turns_wrongly_is_far_from_jeod(
    monkeypatch: pytest.MonkeyPatch, planted: Any, name: str
) -> None:
    monkeypatch.setattr(EllipticOrbit, "turn", planted)
    assert [attitude > 10.0 for attitude, _ in _apart(RUNS[name], 1680)] == [True]


SLUG_SQUARE_FEET = 14.593902937206364 * 0.3048**2
"""kg m^2."""
BRICK = (0.00189422, 0.006211019, 0.007194665)
"""Principal moments of inertia of the tumbling brick, slug ft^2."""
TUMBLING = {
    10: (-2.41890222177841, -23.55256951951579, 28.12859263003343),
    20: (-5.422734679890159, 22.715930576502963, 28.608281747225586),
    30: (12.61839077566776, -17.3974747618308, 31.11958888682995),
}
"""Spin, degrees/s, at times, s, of the first of five simulators, from 10, 20 and 30 degrees/s. Repository
nasa/simupy-flight, `NESC_data/Atmospheric_checkcases/Atmos_02_TumblingBrickNoDamping/Atmos_02_sim_01.csv`. Number
04 has the same to its twelve digits; the others deviate by 1e-5 to 3e-3 degrees/s."""


def test_a_brick_tumbles_as_in_nasas_simulators() -> None:
    a, b, c = (SLUG_SQUARE_FEET * x for x in BRICK)
    body = Body(0.155404754 * 14.593902937206364, (a, 0.0, 0.0, b, 0.0, c))
    zero = Vec3(0.0, 0.0, 0.0)
    spin = Vec3(*(math.radians(x) for x in (10.0, 20.0, 30.0)))
    state = SpatialState(zero, Quat(1.0, 0.0, 0.0, 0.0), zero, spin)
    for expected in TUMBLING.values():
        state = advance(state, Wrench(zero, zero), body, 10.0, 100)
        reached = [math.degrees(x) for x in state.w.columns()]
        # Halves of these steps change 3e-13 degrees/s.
        np.testing.assert_allclose(reached, expected, rtol=0, atol=1e-9)
