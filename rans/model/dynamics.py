"""Equations of motion, written once over fields; torch, NumPy and CasADi run the same source.

World frame W, body frame B at the centre of mass with a full tank. Thrust is constant in B over a control period
(zero-order hold) or over each of its pieces. Disturbances are constant in W. Without both, a spacecraft follows its
drift (`rans.model.drift`); there is no friction. Kernels, controllers and certificates trace this source: the order
of operations decides recorded flights bit by bit.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar

import numpy as np

from rans.model.body import Body, Mounting
from rans.model.drift import FREE, Drift, arctangent
from rans.model.fields import (
    Attitude,
    Field,
    Heading,
    Quat,
    Vec2,
    Vec3,
    Vector,
    at_least,
    map_leaves,
)
from rans.model.rotation import Rotation, at, even, exponential, pulled, spin_series, turned
from rans.model.spacecraft import Spacecraft, Thruster

Rule = tuple[tuple[float, float], ...]

RULES: dict[int, Rule] = {
    count: tuple(
        (float(node + 1) / 2, float(weight) / 2)
        for node, weight in zip(*np.polynomial.legendre.leggauss(count), strict=True)
    )
    for count in range(1, 9)
}
"""Gauss-Legendre nodes and weights on [0, 1], made beforehand: torch cannot trace NumPy's polynomials."""

NODES = 6
"""Nodes of the Gauss-Legendre rule for planar motion. Over one control period its error relative to the effect
of the thrust is below 3e-13 for rotations up to 1 rad, and below 3e-11 up to 2 rad
(docs/decisions/engine.md)."""
_SPATIAL_NODES = 3
"""Nodes of the rule in space: of order six, as the attitude is
(docs/decisions/engine.md)."""


@dataclass(frozen=True)
class State:
    """Motion of the body frame B in the world frame W: `PlanarState` or `SpatialState`."""

    p: Vector
    """Position p_WB, m."""
    attitude: Attitude
    """Attitude R_WB."""
    v: Vector
    """Velocity v_WB, expressed in W, m/s."""
    w: Field
    """Angular velocity, rad/s."""
    notes: Any = None
    """Further values of a task's goal by name, such as the flag of the drawn task: an object of the class
    `goal_notes` of the task; None: the task has none."""
    stores: tuple[Field, ...] = ()
    """Stores of the effectors in the order of `rans.model.spacecraft.Spacecraft.stores`: propellant left, kg,
    then the momentum of each reaction wheel, N m s, then those of further effectors. Goals have none."""

    def normalised(self) -> Self:
        """State with its heading wrapped to [-pi, pi), or with its quaternion scaled to unit length."""
        return replace(self, attitude=self.attitude.normalised())

    def spin(self) -> tuple[Field, ...]:
        """Components of the angular velocity, rad/s."""
        return self.w.columns() if isinstance(self.w, Vec3) else (self.w,)


@dataclass(frozen=True)
class PlanarState(State):
    """Motion in the plane (3DoF), where w is w_WB about z."""

    p: Vec2
    attitude: Heading
    v: Vec2


@dataclass(frozen=True)
class SpatialState(State):
    """Motion in space (6DoF), where w is w_WB_B: relative to W, which may turn, and expressed in B."""

    p: Vec3
    attitude: Quat
    v: Vec3
    w: Vec3


AnyState = TypeVar("AnyState", PlanarState, SpatialState)


@dataclass(frozen=True)
class Wrench:
    """Force and torque about the centre of mass: expressed in B for thrust, in W for a disturbance."""

    force: Vector
    """Force, N."""
    torque: Field
    """Torque, N m; a vector in space, a scalar about z in the plane."""
    exhaust: Field | None = None
    """Sum of the magnitudes of all thrusters' forces, N, which determines the propellant flow; None: not
    computed."""


def thrust(
    craft: Spacecraft, command: Sequence[Field], body: Body | None = None
) -> tuple[Field, ...]:
    """Shares (fields) of its full force that each thruster gives, after faults and the limit of the supply.

    Args:
        craft: spacecraft.
        command: commands from 0 (shut) to 1 (open); commands of other effectors may follow and are ignored.
        body: gains and leaks of the thrusters; None: every thruster follows its command.

    A supply that droops (``thrust_sharing`` of the craft, ``droop`` of the body) is divided among those of its
    thrusters that are in fact open.
    """
    if not craft.has_only_thrusters:
        command = command[craft.thruster_commands]
    command = craft.actuators.levels(command)
    if body is not None and body.gain:
        command = [
            c if _is(gain, 1.0) else c * gain for c, gain in zip(command, body.gain, strict=True)
        ]
    if body is not None and body.leak:
        command = [
            c if _is(leak, 0.0) else c + leak for c, leak in zip(command, body.leak, strict=True)
        ]
    droop = craft.droop if body is None or body.droop is None else body.droop
    if _is(droop, 0.0):
        return tuple(command)
    openings = list(command)
    for members in craft.supplies:
        first, *others = (command[i] for i in members)
        opened = at_least(sum(others, start=first), 1.0)
        sag = 1.0 / (opened if _is(droop, 1.0) else 1.0 + droop * (opened - 1.0))
        for i in members:
            openings[i] = command[i] * sag
    return tuple(openings)


def mean_thrust(craft: Spacecraft, command: Sequence[Field]) -> tuple[Field, ...]:
    """Share of its full force that each thruster gives in the mean of a control period, without faults.

    Args:
        craft: spacecraft.
        command: commands of its thrusters; commands of other effectors may follow and are ignored.

    A pulse that rounds to no count of its valve gives nothing, nor does one below the valve's least.
    """
    own = command[craft.thruster_commands]
    shares = [opening * 0.0 for opening in own]
    for fraction, part in craft.actuators.pulses(own):
        shares = [
            mean + fraction * share for mean, share in zip(shares, thrust(craft, part), strict=True)
        ]
    return tuple(shares)


def _is(field: Field, number: float) -> bool:
    """Whether a field is this number for all spacecraft."""
    return isinstance(field, float) and field == number


def wrench(craft: Spacecraft, command: Sequence[Field], body: Body | None = None) -> Wrench:
    """Wrench of all thrusters in B about the true centre of mass; arguments as for `thrust`."""
    return wrench_of(craft, thrust(craft, command, body), body)


def between(first: Wrench, last: Wrench, fraction: Field) -> Wrench:
    """Wrench at a fraction of the way from one to another."""
    return map_leaves(lambda a, b: a + (b - a) * fraction, first, last)


def wrench_of(craft: Spacecraft, openings: Sequence[Field], body: Body | None) -> Wrench:
    """Wrench in B about the true centre of mass (N, N m) of thrusters with these shares, linear in them.

    `thrust` turns commands into shares first. Sums run in the thrusters' order: another one changes flights bit by
    bit.
    """
    forces = [thruster.force for thruster in craft.thrusters]
    exhaust = None if craft.propellant is None else _dot(openings, forces)
    planar = craft.dimension == 2
    if not craft.thrusters:
        total: list[Field] = [0.0] * craft.degrees_of_freedom
    elif body is not None and body.mountings:
        total = _mounted(craft, openings, body)
    else:
        total = [_dot(openings, column) for column in zip(*craft.wrench_map, strict=True)]
    force, torque = (Vec2(*total[:2]), total[2]) if planar else (Vec3(*total[:3]), Vec3(*total[3:]))
    if body is None or all(_is(x, 0.0) for x in body.centre):
        return Wrench(force, torque, exhaust)
    if isinstance(force, Vec2):
        x, y = body.centre
        return Wrench(force, torque - (x * force.y - y * force.x), exhaust)
    return Wrench(force, torque - Vec3(*body.centre).cross(force), exhaust)


def _mounted(craft: Spacecraft, openings: Sequence[Field], body: Body) -> list[Field]:
    """Wrench about the designed centre of mass of thrusters with true positions and directions."""
    wrenches = []
    for thruster, mounting, opening in zip(craft.thrusters, body.mountings, openings, strict=True):
        magnitude = opening * thruster.force
        force = [magnitude * x for x in mounting.direction]
        wrenches.append([*force, *_torque(craft, thruster, mounting, force)])
    return [sum(column[1:], start=column[0]) for column in zip(*wrenches, strict=True)]


def _torque(
    craft: Spacecraft, thruster: Thruster, mounting: Mounting, force: Sequence[Field]
) -> list[Field]:
    """Torque (B, N m; 1 or 3 numbers) of a force at a thruster's true place about the designed centre of mass."""
    designed = zip(thruster.position, craft.centre_of_mass, mounting.offset, strict=False)
    arm = [position - centre + offset for position, centre, offset in designed]
    if craft.dimension == 2:
        return [arm[0] * force[1] - arm[1] * force[0]]
    return list(Vec3(*arm).cross(Vec3(*force)).columns())


def _dot(factors: Sequence[Field], coefficients: Sequence[float]) -> Field:
    """Sum of products without the terms whose coefficient is zero."""
    terms = [s * c for s, c in zip(factors, coefficients, strict=True) if c != 0.0]
    return sum(terms[1:], start=terms[0]) if terms else factors[0] * 0.0


Rotors = tuple[tuple[Field, ...], tuple[Field, ...] | None]
"""Moments of inertia of wheels about their axes, as the six entries of a tensor in B, kg m^2, at the start and at
the end of a part of a period, linear in time between; end None: constant."""
Piece = tuple[Field, Wrench, Wrench | None, float]
"""Piece of a control period: its duration, s; the thrusters' wrench at its start and at its end, linear in time
between (end None: constant); and an upper bound on its duration, s."""


@dataclass(frozen=True)
class Emptied:
    """What a craft with a tank at a place lacks at an instant, beside the full craft that moves in its stead.

    Motion is that of the full craft under loads in proportion to full mass over mass (`rans.effectors.propellant`).
    """

    centre: Any
    """Centre of mass in B, m: a vector."""
    inertia: tuple[Field, ...]
    """In space, what full mass over mass times the inertia exceeds the full craft's by, as six entries, kg m^2; in
    the plane empty: its torques are in proportion to full inertia over inertia."""
    turning: Field | None
    """In the plane full inertia over inertia, which a torque in W is multiplied by; in space None."""


def undelayed(
    craft: Spacecraft, body: Body, command: Sequence[Field], period: float
) -> Iterator[Piece]:
    """Pieces of a control period (s) in which thrusters follow their command without delay."""
    for fraction, part in craft.actuators.pulses(command[craft.thruster_commands]):
        longest = fraction * period if type(fraction) is float else period
        yield fraction * period, wrench(craft, part, body), None, longest


def advance(
    state: AnyState,
    applied: Wrench,
    body: Body,
    duration: Field,
    substeps: int = 1,
    nodes: int = NODES,
    disturbance: Wrench | None = None,
    drift: Drift = FREE,
    last: Wrench | None = None,
    momentum: tuple[Vec3, Vec3] | None = None,
    growth: tuple[Field, Field] | None = None,
    rotors: Rotors | None = None,
    tank: tuple[Emptied, Emptied] | None = None,
) -> AnyState:
    """State after a wrench, constant or linear in time in B, has acted on the body for a duration.

    In space the angular velocity during the substeps is that in axes that do not turn, in which Euler's equation
    holds; before and after it is relative to W (`rans.model.drift.Drift.rate`).

    Args:
        state: state at the start.
        applied: wrench in B at the start.
        body: mass and inertia.
        duration: duration of all substeps together, s.
        substeps: number of substeps; each is exact up to rounding in the plane and of order six in space.
        nodes: nodes of the quadrature in the plane; float32 needs only four.
        disturbance: second wrench, constant in W, such as that of an uneven floor, a draught or a tether.
        drift: motion of a free point, from the start of the duration.
        last: wrench in B at the end, linear in time from ``applied``; None: constant.
        momentum: angular momentum of the wheels inside the body in B, N m s, at the start and its change over the
            duration; None: no wheels. It does not affect planar motion.
        growth: factor on the disturbance at the start and at the end, linear in time, of a craft that burns
            propellant; None: 1.
        rotors: moments of inertia that the wheels add to those of the body where gravity turns it
            (`rans.model.drift.Drift.gradient`); None: no wheels.
        tank: what the craft lacks at the start and at the end, linear in time; None: its centre of mass does not
            move. The state is that of B's origin before and after it.
    """

    # Changes in a substep of what is linear in time.
    def line(begin: Any, end: Any) -> Any:
        if begin is None or end is None:
            return begin, None
        return begin, map_leaves(lambda a, b: (b - a) * (1.0 / substeps), begin, end)

    h = duration / substeps
    turning = None if momentum is None else momentum[1].scale(1.0 / substeps)
    lines: list[Any] = [
        line(applied, last),
        (None if momentum is None else momentum[0], turning),
        line(*(growth or (None, None))),
        line(*(rotors or (None, None))),
        line(*(tank or (None, None))),
    ]
    # In substeps the state is that of the point of the body in which the centre of mass is in the mean.
    middle = None
    if tank is not None:
        middle = (tank[0].centre + tank[1].centre).scale(0.5)
        state = _at_point(state, middle, 1.0)
    # Each substep begins where the lines of the wrench then are.
    state = _relative_to(state, drift, 1.0)
    for _ in range(substeps):
        load = _Load(*lines, disturbance=disturbance, body=body, drift=drift, point=middle)
        if isinstance(state, PlanarState):
            state = _advance_planar(state, load, h, nodes)  # pyrefly: ignore[bad-assignment]
        else:
            state = _advance_spatial(state, load, h)  # pyrefly: ignore[bad-assignment]
        lines = [
            (begin if change is None else map_leaves(operator.add, begin, change), change)
            for begin, change in lines
        ]
        drift = drift.later(h)
    state = _relative_to(state, drift, -1.0)
    return state if middle is None else _at_point(state, middle, -1.0)


def _at_point(state: Any, point: Any, sign: float) -> Any:
    """State of a point of the body, given in B (sign 1), from that of B's origin, or the other way (-1)."""
    arm = state.attitude.rotate(point.scale(sign))
    speed = state.attitude.rotate(_across(state.w, point.scale(sign)))
    return replace(state, p=state.p + arm, v=state.v + speed)


def _across(w: Any, arm: Any) -> Any:
    """Vector product of an angular velocity (a scalar about z in the plane) with a vector."""
    return w.cross(arm) if isinstance(w, Vec3) else Vec2(-(w * arm.y), w * arm.x)


def _relative_to(state: AnyState, drift: Drift, sign: float) -> AnyState:
    """State in space with the angular velocity of W added to its own (sign 1), or taken off it (-1)."""
    rate = drift.rate()
    if rate is None or not isinstance(state, SpatialState):
        return state
    return replace(state, w=state.w + state.attitude.inverse().rotate(rate.scale(sign)))


@dataclass(frozen=True)
class _Load:
    """Wrenches on a body over one substep, and the drift."""

    thrust: tuple[Wrench, Wrench | None]
    """At the start, and its change until the end of the substep, as of all pairs; None: constant."""
    momentum: tuple[Vec3 | None, Vec3 | None]
    """Angular momentum of the reaction wheels in B, N m s; None: no wheels."""
    swell: tuple[Field | None, Field | None]
    """Factor on the disturbance; None: 1."""
    rotors: tuple[Sequence[Field] | None, Sequence[Field] | None]
    """Moments of inertia of the wheels, kg m^2; see `advance`."""
    tank: tuple[Emptied | None, Emptied | None]
    """What the craft lacks; None: its centre of mass does not move."""
    disturbance: Wrench | None
    body: Body
    drift: Drift
    point: Any
    """Point of the body whose state it is, in B, m; None: B's origin."""

    def pushes(self, turns: Callable[[float], tuple[Any, Any]]) -> Callable[[float], Any]:
        """Acceleration of the point by the thrust in B, m/s^2, as a function of the elapsed share of the substep.

        Args:
            turns: angular velocity in axes that do not turn and its derivative, in B, as a function of this share.
        """
        begin, change = self.thrust
        first: Any = begin.force.scale(1.0 / self.body.mass)
        more = None if change is None else change.force.scale(1.0 / self.body.mass)
        empty, emptier = self.tank

        def push(elapsed: float) -> Any:
            result = first if more is None else first + more.scale(elapsed)
            if empty is None or emptier is None:
                return result
            # The centre of mass, which has this acceleration, is away from the point.
            away = empty.centre + emptier.centre.scale(elapsed) - self.point
            w, faster = turns(elapsed)
            return result - _across(faster, away) - _across(w, _across(w, away))

        return push

    def pulls(self) -> tuple[Any, ...]:
        """Acceleration by the disturbance in W by powers of the elapsed share, m/s^2; empty without one."""
        if self.disturbance is None:
            return ()
        steady = self.disturbance.force.scale(1.0 / self.body.mass)
        return tuple(steady.scale(x) for x in self.swell if x is not None) or (steady,)


def _advance_planar(state: PlanarState, load: _Load, h: Field, nodes: int) -> PlanarState:
    """State after a substep h (s) in the plane: the heading is a polynomial in time, translation a quadrature.

    An effect that is None has no operation here, and so none in a kernel.

    The order of its operations decides recorded flights bit by bit.
    """
    # Torque at the start, and its change until the end.
    begin, change = load.thrust
    torque = begin.torque
    rise = None if change is None else change.torque
    if load.disturbance is not None:
        pull = load.disturbance.torque
        swell = load.swell
        if load.tank[0] is not None and load.tank[1] is not None:
            swell = (load.tank[0].turning, load.tank[1].turning)
        if swell[0] is not None and swell[1] is not None:
            pull, more_pull = pull * swell[0], pull * swell[1]
            rise = more_pull if rise is None else rise + more_pull
        torque = torque + pull
    spin_up = torque * (1.0 / load.body.inertia[0])
    more = None if rise is None else rise * (1.0 / load.body.inertia[0])

    def turns(elapsed: float) -> tuple[Field, Field]:
        frame: Any = load.drift.rate()
        w = state.w if frame is None else state.w + frame.z
        if more is None:
            return w + (elapsed * h) * spin_up, spin_up
        return w + (elapsed * h) * (spin_up + more * (0.5 * elapsed)), spin_up + more * elapsed

    push = load.pushes(turns)

    # Where the rate of W changes, heading and spin relative to it change by as much in the other direction.
    rate = None if load.drift.steady else load.drift.rate()

    def angle(t: Field, elapsed: float) -> Field:
        mean = spin_up if more is None else spin_up + more * (elapsed / 3.0)
        heading = state.attitude.angle + t * (state.w + (0.5 * t) * mean)
        turn = None if rate is None else load.drift.turn(t)
        if rate is None or turn is None:
            return heading
        return heading + (t * rate.z - 2.0 * arctangent(turn.z, turn.w))

    def turn(node: float) -> Vec2:
        return Vec2(*Heading(angle(node * h, node)).columns())

    def times(u: Vec2, a: Any) -> Vec2:
        return Vec2(u.x * a.x - u.y * a.y, u.y * a.x + u.x * a.y)

    # A thrust that is constant in B is rotated once, after its directions are summed.
    rule = RULES[nodes]
    grows = change is not None
    pushes = (times(turn(node), push(node)) if grows else turn(node) for node, _ in rule)
    in_world = (lambda u, s: u.scale(s)) if grows else (lambda u, s: times(u, push(0.0)).scale(s))
    p, v = moved(state.p, state.v, h, load.drift, rule, pushes, in_world, load.pulls())
    faster = spin_up if more is None else spin_up + 0.5 * more
    w = state.w + h * faster
    later = None if rate is None else load.drift.later(h).rate()
    if rate is not None and later is not None:
        w = w + (rate.z - later.z)
    return PlanarState(p, Heading(angle(h, 1.0)), v, w)


def _advance_spatial(state: SpatialState, load: _Load, h: Field) -> SpatialState:
    """State after a substep h (s) in space, computed in the axes of B at its start.

    The spin is a Taylor series, the attitude a Magnus series, and the translation a quadrature. The spin is that in
    axes that do not turn. Where W turns, vectors are turned back into it at every node and at the end.

    The order of its operations decides recorded flights bit by bit.
    """
    inertia = load.body.inertia
    pull = load.disturbance
    drift = load.drift
    rule = RULES[_SPATIAL_NODES]
    # Attitude at the start in the axes that W has at each node.
    whole = drift.turn(h)
    starts = [state.attitude] * len(rule)
    if whole is not None:
        frames: list[Any] = [drift.turn(node * h) for node, _ in rule]
        starts = [frame.inverse().times(state.attitude) for frame in frames]
    # Spin and attitude in the axes of B at the start; torques constant in W turn with it.
    begin, change = load.thrust
    torque = [begin.torque, *([] if change is None else [change.torque])]
    added = [x.inertia for x in load.tank if x is not None]
    stored = [x for x in load.momentum if x is not None]
    steady = None
    carried = []
    gradient = _gradient(drift, h)
    radial = None
    if pull is not None or gradient:
        into_body = state.attitude.inverse()
        steady = None if pull is None else into_body.rotate(pull.torque)
        radial = into_body.rotate(Vec3(1.0, 0.0, 0.0)) if gradient else None
        carried = [into_body.rotate(rate) for rate in _rates_of_frame(drift, h)]
    swell = [x for x in load.swell if x is not None]
    rate, faster = spin_series(
        state.w,
        torque,
        inertia,
        h,
        steady,
        stored,
        swell,
        carried,
        radial,
        gradient,
        [x for x in load.rotors if x is not None],
        added,
    )
    rotation = Rotation(rate, h)
    push = load.pushes(lambda elapsed: (at(rate, elapsed), at(faster, elapsed)))
    turns = [(rotation.vector(node), node, weight) for node, weight in rule]
    pushes = (turned(turn, push(node)) for turn, node, _ in turns)
    if whole is not None:
        pushes = (start.rotate(push) for start, push in zip(starts, pushes, strict=True))

    def in_world(u: Vec3, weight: Field) -> Vec3:
        return state.attitude.rotate(u.scale(weight)) if whole is None else u.scale(weight)

    p, v = moved(state.p, state.v, h, drift, rule, pushes, in_world, load.pulls())
    turn = rotation.whole
    w = at(rate, 1.0)
    if pull is not None and steady is not None and even(inertia) and not (stored or added):
        pulls = [steady] * len(rule)
        if whole is not None:
            pulls = [start.inverse().rotate(pull.torque) for start in starts]
        once, twice = (x.scale(h * (1.0 / inertia[0])) for x in pulled(torque, turns, pulls, swell))
        turn = (state.w + twice).scale(h) + rotation.brackets
        w = state.w + once
    attitude = state.attitude.times(exponential(turn))
    return SpatialState(p, attitude if whole is None else whole.inverse().times(attitude), v, w)


def _rates_of_frame(drift: Drift, h: Field) -> list[Vec3]:
    """Angular velocity of W by powers of the elapsed share of a substep h (s), rad/s; empty where W does not turn.

    It is constant on a circle. Elsewhere a line through its values at two nodes of Gauss turns by the right angle.
    """
    if drift.steady:
        rate = drift.rate()
        return [] if rate is None else [rate]
    (first, _), (second, _) = RULES[2]
    one: Any = drift.later(first * h).rate()
    two: Any = drift.later(second * h).rate()
    rise = (two - one).scale(1.0 / (second - first))
    return [one - rise.scale(first), rise]


def _gradient(drift: Drift, h: Field) -> list[Field]:
    """Three times `Drift.gradient` by powers of the elapsed share of a substep h (s), 1/s^2; empty without one.

    Where it changes, it is a line through two nodes of Gauss, as the rate of the frame.
    """
    now: Any = drift.gradient()
    if now is None:
        return []
    if drift.steady:
        return [3.0 * now]
    (first, _), (second, _) = RULES[2]
    one: Any = drift.later(first * h).gradient()
    two: Any = drift.later(second * h).gradient()
    rise = (two - one) * (3.0 / (second - first))
    return [3.0 * one - rise * first, rise]


def moved(
    p: Any,
    v: Any,
    h: Field,
    drift: Drift,
    rule: Rule,
    pushes: Iterator[Any],
    in_world: Callable[[Any, Field], Any],
    pulls: Sequence[Any] = (),
) -> tuple[Any, Any]:
    """Position and velocity in W after a substep h.

    The acceleration a(t) of the thrust is replaced by a velocity change w_i h a(s_i h) at every node s_i of
    weight w_i, which the drift propagates for the rest of the substep. If the drift is a straight line, the
    changes are summed first: v(h) = v + h sum w_i a(s_i h) and p(h) = p + v h + h^2 sum w_i (1 - s_i) a(s_i h).
    The contribution of a disturbance is then exact, because its force does not rotate.

    Args:
        p: position in W at the start, m.
        v: velocity in W at the start, m/s.
        h: duration of the substep, s.
        drift: motion of a free point, from the start of the substep.
        rule: nodes and weights of the quadrature.
        pushes: acceleration at each node, in any representation that can be summed.
        in_world: converts such a sum, times a scalar, to a vector in W.
        pulls: second acceleration in W by powers of the elapsed share, m/s^2: none, constant or linear.
    """
    # Curved drift: every change of velocity is propagated by itself.
    if not drift.in_straight_lines:
        p, v = drift.carry(p, v, h)
        for (node, weight), push in zip(rule, pushes, strict=True):
            kick = in_world(push, weight * h)
            for power, pull in enumerate(pulls):
                kick = kick + pull.scale(weight * node**power * h)
            q, u = drift.later(node * h).kicked(kick, (1 - node) * h)
            p = p + q
            v = v + u
        return p, v
    # A straight line: sum w_i a(s_i h) and sum w_i (1 - s_i) a(s_i h), turned into W at once.
    of_velocity: Any = type(p)(*(0.0,) * len(p.columns()))
    of_position = of_velocity
    for (node, weight), push in zip(rule, pushes, strict=True):
        of_velocity = of_velocity + push.scale(weight)
        of_position = of_position + push.scale(weight * (1 - node))
    velocity_change = in_world(of_velocity, h)
    displacement = in_world(of_position, h * h)
    # A pull of the power k - 1 of the elapsed share has the integrals h / k and h^2 / (k (k + 1)).
    for power, pull in enumerate(pulls, 1):
        velocity_change = velocity_change + pull.scale(h * (1.0 / power))
        displacement = displacement + pull.scale(h * h * (1.0 / (power * (power + 1))))
    p, v = drift.carry(p, v, h)
    return p + displacement, v + velocity_change
