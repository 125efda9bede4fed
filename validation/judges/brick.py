"""A tumbling brick against five simulators of NASA: atmospheric case 2 of its Engineering and Safety Center."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from rans.model.body import Body
from rans.model.dynamics import SpatialState, Wrench, advance
from rans.model.fields import Quat, Vec3
from validation.judges.judge import Judge, Row
from validation.study.checks import Check

_SLUG = 14.593902937206364
"""kg."""
_SLUG_SQUARE_FEET = _SLUG * 0.3048**2
"""kg m^2."""
_MASS = 0.155404754
"""Slug."""
_INERTIA = (0.00189422, 0.006211019, 0.007194665)
"""Principal moments of inertia, slug ft^2."""
START = (10.0, 20.0, 30.0)
"""Spin at the start in body axes, degrees/s; nothing acts."""
FIGURES: dict[str, dict[int, tuple[float, float, float]]] = {
    "01": {
        10: (-2.41890222177841, -23.55256951951579, 28.12859263003343),
        20: (-5.422734679890159, 22.715930576502963, 28.608281747225586),
        30: (12.61839077566776, -17.3974747618308, 31.11958888682995),
    },
    "02": {
        10: (-2.4185994104954416, -23.552745278845812, 28.128483920058063),
        20: (-5.42335143307227, 22.715824452400714, 28.608345527283056),
        30: (12.619216961385067, -17.396709626714614, 31.119942061280724),
    },
    "04": {
        10: (-2.41890222177, -23.5525695195, 28.12859263),
        20: (-5.42273467991, 22.7159305765, 28.6082817473),
        30: (12.6183907757, -17.3974747619, 31.1195888868),
    },
    "05": {
        10: (-2.4188901052993446, -23.552576515835174, 28.128588284177358),
        20: (-5.422759331082723, 22.715926274487828, 28.608284306167207),
        30: (12.618423766019587, -17.397444101295715, 31.11960300607054),
    },
    "06": {
        10: (-2.415900013834607, -23.5530760350449, 28.128294469178325),
        20: (-5.425679572651192, 22.714775051002913, 28.608926841012615),
        30: (12.620844062702608, -17.394550197091117, 31.12073831148526),
    },
}
"""Spin of each simulator at times, s, in degrees/s. Repository nasa/simupy-flight,
`NESC_data/Atmospheric_checkcases/Atmos_02_TumblingBrickNoDamping/Atmos_02_sim_NN.csv`."""
NESC = Judge(
    "NASA's five simulators",
    "nasa/simupy-flight, NESC_data/Atmospheric_checkcases/Atmos_02_TumblingBrickNoDamping",
    "70754e6916afc206e8c0abb386d1a9c98bf8f561",
    "Five teams of NASA wrote them apart from one another, in feet and slugs, and each integrates in its own way.",
)


def flown() -> dict[int, np.ndarray]:
    """Our spin, degrees/s, at the times of the figures."""
    a, b, c = (_SLUG_SQUARE_FEET * x for x in _INERTIA)
    body = Body(_MASS * _SLUG, (a, 0.0, 0.0, b, 0.0, c))
    zero = Vec3(0.0, 0.0, 0.0)
    state = SpatialState(zero, Quat(1.0, 0.0, 0.0, 0.0), zero, Vec3(*map(math.radians, START)))
    spins, now = {}, 0
    for time in FIGURES["01"]:
        # Halves of these steps of 0.1 s change 3e-13 degrees/s.
        state = advance(state, Wrench(zero, zero), body, float(time - now), 10 * (time - now))
        spins[time] = np.degrees(state.w.columns())
        now = time
    return spins


def rows() -> Iterator[Row]:
    """One row: our distance from the nearest simulator, and theirs from one another."""
    ours = flown()
    apart = {
        name: max(float(np.abs(ours[time] - spin).max()) for time, spin in spins.items())
        for name, spins in FIGURES.items()
    }
    spread = max(
        float(np.abs(np.subtract(one[time], other[time])).max())
        for one in FIGURES.values()
        for other in FIGURES.values()
        for time in one
    )
    check = Check(
        "spin", max(apart.values()), spread, "degrees/s", "The spread of NASA's own simulators."
    )
    nearest = min(apart, key=lambda name: apart[name])
    near = Check(
        f"spin, simulator {nearest}", apart[nearest], 1e-9, "degrees/s", "Digits of its figures."
    )
    yield Row(
        NESC,
        "NESC brick",
        "brick without forces, 30 s: the farthest and the nearest of five",
        "Atmos_02_sim_01.csv, 02, 04, 05, 06",
        (check, near),
        f"{spread:.0e} degrees/s",
    )
