"""Motion of a craft with a pendulum inside, which is the equivalent of a sloshing liquid.

The integration has the engine's rules: fields, fixed steps, SI; SciPy's flights test it
(`tests/slosh/test_slosh_accuracy.py`).
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans.extend import (
    Begun,
    Body,
    Drift,
    Effector,
    Field,
    JointMotion,
    Spacecraft,
    Store,
    Timing,
    Vec3,
    Wrench,
    counted,
    map_leaves,
)
from rans.model.dynamics import NODES
from rans_missions.slosh.pendulum import Pair, Rod

LARGEST = 1e9
"""Largest mass and length, and bound of a coordinate and of a rate (SI), as of a spacecraft."""
_USUAL_SPIN = 1.0
"""Spin of a craft that steps are chosen for, rad/s: as in `rans.model.accuracy`."""
STEP = 0.1
"""Longest step, as the angle turned at the fastest usual rate, rad: 10 s of restless flight of six craft, two of
them without friction, are then within 1e-6 m and 3e-6 rad of SciPy."""
FAST, FAST_SPIN = 0.2, 0.045
"""Angles that rod and craft turn in a step up to which their motion counts as accurate, rad. A rod is fast
for moments only. A craft that spins at 10 rad/s for 10 s is 9e-5 rad off with steps of
0.11 rad, and 5e-6 with these."""
DECAY = 1.0
"""Longest step times the rate at which friction stops the rod; the method is stable up to 2.78."""
MOST_STEPS = 64
"""Largest number of steps in a piece of a control period, which bounds the length of generated programs."""


@dataclass(frozen=True)
class Pendulum(Effector):
    """Sloshing liquid as an effector: its states are where the rod points relative to the craft, and its rate."""

    slosh: Rod
    craft: Spacecraft
    commands = ()

    @property
    def stores(self) -> tuple[Store, ...]:
        """Plane: angle of the rod, rad, and its rate, rad/s. Space: unit vector in B and its rate, 1/s."""
        if self.craft.dimension == 3:
            directions = zip("xyz", self.slosh.direction, strict=True)
            return (
                *(Store(f"slosh direction {axis}", "", e, -1.0, 1.0) for axis, e in directions),
                *(Store(f"slosh rate {axis}", "1/s", 0.0, -LARGEST, LARGEST) for axis in "xyz"),
            )
        return (
            Store("slosh angle", "rad", 0.0, -math.pi, math.pi),
            Store("slosh rate", "rad/s", 0.0, -LARGEST, LARGEST),
        )

    def begin(self, begun: Begun) -> Swinging:
        """Action over a control period: it moves craft and rod together (`Swinging.advance`)."""
        return Swinging(self, begun.stores, begun.body)


class Swinging(JointMotion):
    """Action of the pendulum over a control period."""

    def __init__(self, pendulum: Pendulum, stores: Sequence[Field], body: Body) -> None:
        self._stores = tuple(stores)
        self._pair = Pair.of(pendulum.slosh, pendulum.craft, body)
        self._pace, self._decay = paces(pendulum.slosh, pendulum.craft)

    def stores(self, time: Field) -> tuple[Field, ...]:
        """States of the pendulum after the parts of the period so far."""
        return self._stores

    def steps(self, longest: float) -> int:
        """Number of integration steps in a part of the period that lasts so long at most, s."""
        return _steps(longest, self._pace, self._decay)

    def advance(
        self,
        state: Any,
        applied: Wrench,
        body: Body,
        duration: Field,
        steps: int = 1,
        nodes: int = NODES,
        disturbance: Wrench | None = None,
        drift: Drift | None = None,
        last: Wrench | None = None,
        momentum: tuple[Vec3, Vec3] | None = None,
        *_: Any,
    ) -> Any:
        """State after a wrench has acted for a duration; arguments as of `rans.model.dynamics.advance`.

        Runge-Kutta steps of order four for craft and rod, and for the centre of mass of both.
        """
        pair = self._pair
        h = duration / steps
        motion = pair.begin(state, self._stores)
        away, speed = pair.centre(motion)
        p = state.p + away
        v = state.v + speed
        change = None if last is None else map_leaves(operator.sub, last, applied)

        def rates(now: Any, elapsed: float) -> tuple[Any, Any]:
            load = applied
            if change is not None:
                load = map_leaves(lambda a, b: a + b * elapsed, applied, change)
            wheels = None if momentum is None else momentum[0] + momentum[1].scale(elapsed)
            return pair.rates(load, disturbance, wheels, now)

        def after(rates: Any, time: Field) -> Any:
            return map_leaves(lambda x, rate: x + rate * time, motion, rates)

        # Runge and Kutta's four stages; the wrench is a line over all steps.
        for k in range(steps):
            begin, middle, end = (x / steps for x in (k, k + 0.5, k + 1))
            one, c1 = rates(motion, begin)
            two, c2 = rates(after(one, 0.5 * h), middle)
            three, c3 = rates(after(two, 0.5 * h), middle)
            four, c4 = rates(after(three, h), end)
            mean = map_leaves(
                lambda a, b, c, d: (a + (b + c) * 2.0 + d) * (1.0 / 6.0), one, two, three, four
            )
            motion = after(mean, h)
            # The centre of mass drifts as a free point does, and the forces come on top.
            p, v = (p + v.scale(h), v) if drift is None else drift.carry(p, v, h)
            p = p + (c1 + c2 + c3).scale(h * h * (1.0 / 6.0))
            v = v + (c1 + (c2 + c3).scale(2.0) + c4).scale(h * (1.0 / 6.0))

        motion, self._stores = pair.end(motion)
        away, speed = pair.centre(motion)
        return pair.state(p - away, v - speed, motion)


def paces(slosh: Rod, craft: Spacecraft, body: Body | None = None) -> tuple[float, float]:
    """Fastest usual rate of craft and rod, and rate at which friction stops the rod, rad/s and 1/s.

    The rod is fastest where it has fallen from above its hinge to below it, under an acceleration a of the craft:
    its energy then gives it the rate 2 sqrt(a / l). Without friction thrust in step with the rod may make it
    faster (`inaccuracy`).

    Args:
        slosh: of the craft as designed.
        craft: as designed.
        body: true body, of floats; None: as designed.
    """
    # The centre of mass of the body moves the arm in any direction.
    centre = () if body is None else body.centre or ()
    pair = Pair.of(slosh, craft, Body.of(craft))
    arm = math.hypot(*pair.arm.columns()) + math.hypot(*centre) / (1.0 - pair.fraction)
    # Half of the thrusters push together at most; the centrifugal field of the arm acts as gravity too.
    pull = 0.5 * sum(thruster.force for thruster in craft.thrusters) / craft.mass
    pull += _USUAL_SPIN**2 * arm
    pace = max(_USUAL_SPIN, 2.0 * math.sqrt(pull / slosh.length))
    # Friction turns rod and rigid part, whose inertia is least about its worst axis.
    pair = pair if body is None else Pair.of(slosh, craft, body)
    xx, xy, xz, yy, yz, zz = pair.inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    least = float(np.linalg.eigvalsh(tensor)[0] if craft.dimension == 3 else zz)
    mobility = (1.0 / pair.reduced + (arm + slosh.length) ** 2 / least) / slosh.length**2
    return pace, slosh.damping * mobility


def inaccuracy(slosh: Rod, craft: Spacecraft, states: Any, going: Any, timing: Timing) -> str:
    """Sentence that rod or craft turn too fast for their steps, or ""; see `Effector.inaccuracy`.

    Rates that are no finite numbers are left out.
    """
    spin = np.linalg.norm(np.array(states.spin()), axis=0)
    rod, spin = (
        float(np.max(rates, where=going & np.isfinite(rates), initial=0.0))
        for rates in (rod_rate(slosh, craft, states), spin)
    )
    needed = math.ceil(max(rod / FAST, spin / FAST_SPIN) * timing.control_period - 1e-9)
    taken = max(timing.substeps or 1, _steps(timing.control_period, *paces(slosh, craft)))
    if needed <= taken:
        return ""
    return (
        f"swings the liquid of {craft.name} at up to {rod:.3g} rad/s and spins it at up to {spin:.3g} rad/s, for "
        f"which {counted(taken, 'step')} of a control period of {timing.control_period:g} s are too few; set "
        f"timing.substeps to {needed} or more. The usual cause is a liquid with little friction, which thrust in "
        "step with it makes ever faster, or a controller that does not stop its spin."
    )


def rod_rate(slosh: Rod, craft: Spacecraft, states: Any) -> np.ndarray:
    """Rate of the rod in W, rad/s, in the shape of the states' fields, such as (T + 1, N)."""
    own = Pendulum(slosh, craft).stores
    first = craft.stores.index(own[0])
    stores = states.stores[first : first + len(own)]
    if craft.dimension == 2:
        return np.abs(states.w + stores[1])
    rod, slip = Vec3(*stores[:3]), Vec3(*stores[3:])
    return np.asarray((slip + states.w.cross(rod)).norm())


def _steps(longest: float, pace: float, decay: float) -> int:
    """Number of integration steps in a time, s, at the rates of `paces`."""
    needed = max(math.ceil(longest * pace / STEP - 1e-9), math.ceil(longest * decay / DECAY))
    return min(needed, MOST_STEPS)
