"""Whole flights by equations of this file's own, for every effect together: SciPy's DOP853.

A craft carries rotors, each with a speed of its own relative to the body, and a tank. Rotors with the axial inertia
J, axes a and speeds s relative to the body have the angular momenta J (w . a + s) along them, which motors change.
Propellant leaves with the velocity that it had as a part of the craft. Where gravity turns the craft its torque is
3 n^2 r x I r, with the unit vector r away from the planet. The plane is the same motion in space, with forces that
lie in it. On an orbit states are in the Hill frame, which turns with n.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rans.flight import Flight
from rans.model.actuators import Propellant, Pulsed, Throttle
from rans.model.drift import ClohessyWiltshire, UniformGravity
from rans.model.fields import leaves, map_leaves
from rans.randomization.parameters import EpisodeParameters

GRAVITY = 9.80665
"""m/s^2, of the specific impulse."""


@dataclass
class Health:
    """Factor and offset of every thruster's share."""

    gain: np.ndarray
    leak: np.ndarray


class Oracle:
    """One flight of a craft under drawn parameters.

    Args:
        flight: whose starts and commands are flown again.
        drawn: parameters of its episodes as arrays (N,); None: everything is nominal.
        number: of the episode.
    """

    def __init__(self, flight: Flight, drawn: EpisodeParameters | None, number: int) -> None:
        self.craft = craft = flight.craft
        self.period = flight.timing.control_period
        self.drift = flight.task.drift
        self.flight = flight
        self.number = number
        self.drawn = None if drawn is None else map_leaves(self._one, drawn)
        count = len(craft.thrusters)
        self.mass = craft.mass
        self.inertia = np.array(craft.inertia)
        if craft.dimension == 2:
            self.inertia = np.diag(np.diag(self.inertia))
        self.centre = np.array(craft.centre_of_mass)
        self.sound = self.failed = Health(np.ones(count), np.zeros(count))
        self.fails = math.inf
        self.droop = 1.0 if craft.thrust_sharing == "split" else 0.0
        self.directions = np.array([t.direction for t in craft.thrusters])
        self.places = np.array([t.position for t in craft.thrusters])
        self.swings = 1.0
        self.sticks = 1.0
        if self.drawn is not None:
            self._randomize(self.drawn)
        self.axes = np.array([wheel.axis for wheel in craft.wheels]).reshape(-1, 3)
        self.rotors = np.array([wheel.inertia for wheel in craft.wheels])
        drift = self.drift
        n = drift.mean_motion if isinstance(drift, ClohessyWiltshire) else 0.0
        self.turning = np.array([0.0, 0.0, n])
        self.tide = 3.0 * n * n * (drift.gradient() is not None)
        self.gravity = np.zeros(3)
        if isinstance(drift, UniformGravity):
            self.gravity[: len(drift.acceleration)] = drift.acceleration

    def _one(self, field: Any) -> Any:
        return float(field[self.number]) if np.ndim(field) == 1 else field

    def _randomize(self, drawn: EpisodeParameters) -> None:
        body = drawn.body
        self.mass = body.mass
        if self.craft.dimension == 2:
            self.inertia = np.diag([1.0, 1.0, body.inertia[0]])
        else:
            xx, xy, xz, yy, yz, zz = body.inertia
            self.inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        self.centre = self.centre + np.resize([*body.centre, 0.0], 3)
        self.sound = self.failed = Health(np.array(body.gain), np.array(body.leak))
        if drawn.fault is not None:
            self.failed = Health(np.array(drawn.fault.gain), np.array(drawn.fault.leak))
            self.fails = drawn.fault.begins
        if body.droop is not None:
            self.droop = body.droop
        for number, mounting in enumerate(body.mountings):
            size = self.craft.dimension
            self.directions[number, :size] = mounting.direction
            self.places[number, :size] += mounting.offset

    # Thrust.

    def supplied(self, opened: np.ndarray, health: Health) -> np.ndarray:
        """Share of its force that every thruster gives: its valve, its health and what its supply can feed."""
        shares = health.gain * opened + health.leak
        result = shares.copy()
        for members in self.craft.supplies:
            fed = shares[list(members)].sum()
            result[list(members)] /= 1.0 + self.droop * max(fed - 1.0, 0.0)
        return result

    def valves(self, commands: np.ndarray) -> list[tuple[float, np.ndarray]]:
        """Instants at which a valve is told to move, and where all of them are told to be from then on."""
        kind = self.craft.actuators
        orders = [(-math.inf, np.zeros(len(self.craft.thrusters)))]
        for k, command in enumerate(commands):
            begins = k * self.period
            if isinstance(kind, Pulsed):
                counts = np.floor(command * kind.counts + 0.5)
                counts[counts < kind.least] = 0.0
                orders += [
                    (begins + now / kind.counts * self.period, 1.0 * (counts > now))
                    for now in sorted({0.0, *counts[counts < kind.counts].tolist()})
                ]
            elif isinstance(kind, Throttle) and not kind.always_lit:
                lit = command >= kind.least / 2
                orders.append((begins, np.where(lit, np.maximum(command, kind.least), 0.0)))
            else:
                orders.append((begins, command))
        return orders

    def dwelling(self, commands: np.ndarray) -> np.ndarray:
        """On/off commands as valves carry them out that may not move again too soon."""
        if self.drawn is None or self.drawn.dwell is None:
            return commands
        result = commands.copy()
        for valve in range(commands.shape[1]):
            is_open = 0.0
            moved = -math.inf
            for k, wanted in enumerate(commands[:, valve]):
                least = self.drawn.dwell.on if is_open else 0.0
                if wanted != is_open and k * self.period - moved >= least - 1e-6:
                    is_open = wanted
                    moved = k * self.period
                result[k, valve] = is_open
        return result

    def thrusts(
        self, commands: np.ndarray
    ) -> Iterator[tuple[float, float, np.ndarray, np.ndarray]]:
        """Pieces (begin, end, shares at its begin, shares at its end) of the whole flight, linear in time."""
        orders = self.valves(self.dwelling(commands))
        lag = None if self.drawn is None else self.drawn.lag
        late = 0.0 if lag is None else lag.latency
        rise = 0.0 if lag is None or lag.rise is None else lag.rise
        end = len(commands) * self.period
        edges = {k * self.period for k in range(len(commands) + 1)} | {self.fails}
        for time, _ in orders[1:]:
            edges |= {time + late, time + late + rise}
        edges = sorted(edge for edge in edges if 0.0 <= edge <= end)
        edges = [0.0, *(b for a, b in itertools.pairwise(edges) if b - a > 1e-12)]
        settled = late + rise
        for begin, until in itertools.pairwise(edges):
            health = self.failed if begin >= self.fails - 1e-13 else self.sound
            # Inside the piece nothing jumps.
            a, b = (
                self._shares(orders, begin + x * (until - begin), health, late, rise, settled)
                for x in (0.25, 0.75)
            )
            yield begin, until, 1.5 * a - 0.5 * b, 1.5 * b - 0.5 * a

    def _shares(
        self,
        orders: Sequence[tuple[float, np.ndarray]],
        time: float,
        health: Health,
        late: float,
        rise: float,
        settled: float,
    ) -> np.ndarray:
        first = max(k for k, (when, _) in enumerate(orders) if when + settled <= time)
        shares = before = self.supplied(orders[first][1], health)
        for when, opened in orders[first + 1 :]:
            gone = time - when - late
            if gone < 0.0:
                break
            after = self.supplied(opened, health)
            done = min(gone / rise, 1.0) if rise > 0.0 else 1.0
            shares = shares + (after - before) * done
            before = after
        return shares

    # Motion.

    def disturbance(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """Force and torque in W over a control period, N and N m."""
        force = np.zeros(3)
        torque = np.zeros(3)
        if self.drawn is None:
            return force, torque
        parts = [(self.drawn.push, 1.0)]
        if self.drawn.swing is not None:
            middle = (step + 0.5) * self.period
            swing = self.drawn.swing
            parts.append((swing.amplitude, math.sin(swing.rate * middle + swing.phase)))
        if (kick := self.drawn.kick) is not None:
            parts.append((kick.impulse, float(kick.step == step) / self.period))
        for one, size in parts:
            if one is None:
                continue
            numbers = [float(x) for x in leaves(one)]
            if self.craft.dimension == 2:
                force += size * np.array([*numbers[:2], 0.0])
                torque += size * np.array([0.0, 0.0, numbers[2]])
            else:
                force += size * np.array(numbers[:3])
                torque += size * np.array(numbers[3:])
        return force, torque

    def fly(self) -> np.ndarray:
        """States at the ends of all periods: (T + 1, columns of `leaves` of a state)."""
        craft = self.craft
        thrusters = len(craft.thrusters)
        commands = self.flight.commands[:, self.number]
        forces = self.directions * np.array([[t.force] for t in craft.thrusters])
        torques = np.cross(self.places - self.centre, forces)
        if craft.dimension == 2:
            torques[:, :2] = 0.0
        sizes = np.array([t.force for t in craft.thrusters])
        y = self._begun()
        result = [y]
        motors = np.zeros(len(self.rotors))
        for begin, end, first, last in self.thrusts(commands[:, :thrusters]):
            step = math.floor(begin / self.period + 1e-9)
            if abs(begin - step * self.period) < 1e-9:
                motors = self._motors(y, commands[step, thrusters:])
            load = (
                (first @ forces, first @ torques),
                ((last - first) @ forces, (last - first) @ torques),
            )
            flows = first @ sizes, (last - first) @ sizes
            y = self._carried(y, end - begin, load, flows, motors, self.disturbance(step))
            if abs(end - (step + 1) * self.period) < 1e-9:
                result.append(y)
        return np.array([self._columns(y) for y in result])

    def _motors(self, y: np.ndarray, command: np.ndarray) -> np.ndarray:
        """Motor torques that keep every rotor within its largest momentum until the end of the period."""
        if not len(self.rotors):
            return np.zeros(0)
        momenta = self._momenta(y)
        torque = command * [wheel.max_torque for wheel in self.craft.wheels]
        limit = np.array([wheel.max_momentum for wheel in self.craft.wheels])
        after = np.clip(momenta + torque * self.period, -limit, limit)
        return (after - momenta) / self.period

    def _momenta(self, y: np.ndarray) -> np.ndarray:
        return self.rotors * (self.axes @ y[10:13] + y[14 : 14 + len(self.rotors)])

    def _begun(self) -> np.ndarray:
        """Position, attitude (w, x, y, z), velocity, spin, propellant and the speeds of rotors at the start."""
        columns = [float(x[0, self.number]) for x in leaves(self.flight.states)]
        if self.craft.dimension == 2:
            x, y, angle, u, v, w, *stores = columns
            turned = (math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2))
            motion = [x, y, 0.0, *turned, u, v, 0.0, 0.0, 0.0, w]
        else:
            motion, stores = columns[:13], columns[13:]
        motion[10:13] = motion[10:13] + self.turning @ _matrix(*motion[3:7])
        left = stores.pop(0) if self.craft.propellant is not None else 0.0
        speeds = [
            h / wheel.inertia - np.dot(wheel.axis, motion[10:13])
            for h, wheel in zip(stores, self.craft.wheels, strict=False)
        ]
        return np.array([*motion, left, *speeds])

    def _columns(self, y: np.ndarray) -> list[float]:
        """The state as a flight lists it."""
        stores = [*([y[13]] if self.craft.propellant is not None else []), *self._momenta(y)]
        spin = y[10:13] - self.turning @ _matrix(*y[3:7])
        if self.craft.dimension == 3:
            return [*y[:10], *spin, *stores]
        angle = 2 * math.atan2(y[6], y[3])
        return [y[0], y[1], angle, y[7], y[8], spin[2], *stores]

    def _rate(
        self, load: Any, flows: Any, motors: Any, pull: Any, duration: float, speed: float
    ) -> Any:
        """Derivative of a state, as a function of time and state."""
        raise NotImplementedError

    def _carried(
        self, y: np.ndarray, duration: float, load: Any, flows: Any, motors: np.ndarray, pull: Any
    ) -> np.ndarray:
        """The state after a piece; where the tank runs empty, thrust ends."""
        speed = math.inf
        if self.craft.propellant is not None:
            speed = self.craft.propellant.specific_impulse * GRAVITY
        burning = self.craft.propellant is None or y[13] > 1e-13
        gone = 0.0
        if not burning:
            load = np.zeros((2, 2, 3))
            flows = (0.0, 0.0)
        elif math.isfinite(speed):
            # The instant at which the tank is empty: left = (first t + change t^2 / (2 duration)) / speed.
            need = flows[0] + 0.5 * flows[1]
            if need * duration / speed > y[13]:
                a = 0.5 * flows[1] / duration
                b = flows[0]
                c = -y[13] * speed
                gone = 2 * -c / (b + math.sqrt(b * b - 4 * a * c))
        until = gone or duration
        rate = self._rate(load, flows, motors, pull, duration, speed)
        y = _integrated(rate, y, until)
        if gone and gone < duration:
            y[13] = 0.0
            return self._carried(y, duration - gone, load, flows, motors, pull)
        return y


class RigidOracle(Oracle):
    """One flight of a craft in which no mass moves but propellant, by momenta in axes that do not turn.

    The hub, the propellant and the rotors have a momentum P and an angular momentum L about the origin. What it
    loses takes the momentum that it had in the tank: P' = force - flow v and L' = moment - flow (x x v + k w), with
    the place x of the tank, its velocity v and its moment of inertia k for each kilogram. Velocity and spin
    follow from P and L at every instant. Gravity pulls hub and propellant each where it is.
    """

    def __init__(self, flight: Flight, drawn: EpisodeParameters | None, number: int) -> None:
        super().__init__(flight, drawn, number)
        tank: Any = self.craft.propellant or Propellant(0.0, 1.0)
        self.arm = np.zeros(3)
        self.round = self.inertia / self.mass
        if tank.position is not None:
            self.arm = np.array(tank.position) - self.centre
            self.round = 0.4 * tank.radius**2 * np.eye(3)
        self.hub = self.mass - tank.mass
        self.hub_arm = -self.arm * tank.mass / self.hub
        self.weighed = math.nan
        self.mobility: Any = None
        both = tank.mass * (self.round + _about(self.arm)) + self.hub * _about(self.hub_arm)
        self.hub_inertia = self.inertia - both
        if self.craft.dimension == 2:
            self.hub_inertia = np.diag([1.0, 1.0, self.hub_inertia[2, 2]])

    def _momenta(self, y: np.ndarray) -> np.ndarray:
        return y[14:-1]

    def _begun(self) -> np.ndarray:
        y = super()._begun()
        momenta = super()._momenta(y)
        y[7:10] += _cross(self.turning, y[:3])
        turn = _matrix(*y[3:7])
        mass, first, second, inertia = self._whole(y[13])
        v, w = turn.T @ y[7:10], y[10:13]
        push = mass * v + _cross(w, first)
        spin = _cross(first, v) + (inertia + second) @ w + self.axes.T @ momenta
        y[7:10] = turn @ push
        y[10:13] = turn @ spin + _cross(y[:3], y[7:10])
        return np.array([*y[:14], *momenta, 0.0])

    def _whole(self, left: float) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Mass, its first and second moments about B's origin, and inertia about the parts' own centres."""
        first = self.hub * self.hub_arm + left * self.arm
        second = self.hub * _about(self.hub_arm) + left * _about(self.arm)
        return self.hub + left, first, second, self.hub_inertia + left * self.round

    def _motion(self, y: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocity of B's origin and angular velocity, both in B."""
        if y[13] != self.weighed:
            mass, first, second, inertia = self._whole(y[13])
            across = np.cross(np.eye(3), first)
            system = np.block([[mass * np.eye(3), across.T], [across, inertia + second]])
            self.weighed = y[13]
            self.mobility = np.linalg.inv(system)
        about = turn.T @ (y[10:13] - _cross(y[:3], y[7:10])) - self.axes.T @ self._momenta(y)
        solved = self.mobility @ np.array([*(turn.T @ y[7:10]), *about])
        return solved[:3], solved[3:]

    def _columns(self, y: np.ndarray) -> list[float]:
        turn = _matrix(*y[3:7])
        v, w = self._motion(y, turn)
        frame = Rotation.from_rotvec(self.turning * y[-1])
        attitude = frame.inv() * Rotation.from_quat(y[3:7], scalar_first=True)
        p = frame.inv().apply(y[:3])
        speed = frame.inv().apply(turn @ v) - _cross(self.turning, p)
        turned = attitude.as_quat(scalar_first=True)
        return super()._columns(np.array([*p, *turned, *speed, *w, *y[13:]]))

    def _rate(
        self, load: Any, flows: Any, motors: Any, pull: Any, duration: float, speed: float
    ) -> Any:
        (force, torque), (more_force, more_torque) = load
        n = self.turning[2]

        def rate(time: float, y: np.ndarray) -> np.ndarray:
            share = time / duration
            turn = _matrix(*y[3:7])
            v, w = self._motion(y, turn)
            flow = (flows[0] + share * flows[1]) / speed
            mass, first, _, inertia = self._whole(y[13])
            tank = y[:3] + turn @ self.arm
            hub = y[:3] + turn @ self.hub_arm
            centre = y[:3] + turn @ first / mass
            c, s = math.cos(n * y[-1]), math.sin(n * y[-1])
            frame = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            outwards = frame[:, 0]

            def falls(x: np.ndarray) -> np.ndarray:
                return self.gravity + n * n * (3.0 * outwards * (outwards @ x) - x)

            # Thrust, which acts where the nozzles are, and the disturbance at the centre of mass.
            thrust = turn @ (force + share * more_force)
            push = frame @ pull[0]
            forces = thrust + push - flow * (turn @ (v + _cross(w, self.arm)))
            moments = _cross(y[:3], thrust) + turn @ (torque + share * more_torque)
            moments += _cross(centre, push) + frame @ pull[1]
            moments -= flow * _cross(tank, turn @ (v + _cross(w, self.arm)))
            moments -= flow * (turn @ self.round @ w)
            if self.tide:
                every = inertia + (self.axes.T * self.rotors) @ self.axes
                for weight, x in ((self.hub, hub), (y[13], tank)):
                    forces = forces + weight * falls(x)
                    moments += _cross(x, weight * falls(x))
                moments += self.tide * _cross(outwards, turn @ every @ turn.T @ outwards)
            else:
                forces = forces + mass * falls(centre)
                moments += _cross(centre, mass * falls(centre))
            turned = _turned(y[3:7], w)
            return np.array([*(turn @ v), *turned, *forces, *moments, -flow, *motors, 1.0])

        return rate


def _cross(a: Any, b: Any) -> np.ndarray:
    """Vector product; NumPy's own takes ten times as long."""
    x, y, z = a
    u, v, w = b
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def _about(arm: np.ndarray) -> np.ndarray:
    """Moments of inertia of 1 kg at an arm."""
    return arm @ arm * np.eye(3) - np.outer(arm, arm)


def _integrated(rate: Any, y: np.ndarray, duration: float) -> np.ndarray:
    y = solve_ivp(rate, (0.0, duration), y, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    y[3:7] /= math.hypot(*y[3:7])
    return y


def _turned(attitude: Any, spin: Any) -> tuple[float, float, float, float]:
    """Rate of a quaternion (w, x, y, z) by a spin in B."""
    a, b, c, d = attitude
    p, q, r = spin
    return (
        -0.5 * (b * p + c * q + d * r),
        0.5 * (a * p + c * r - d * q),
        0.5 * (a * q + d * p - b * r),
        0.5 * (a * r + b * q - c * p),
    )


def _matrix(a: float, b: float, c: float, d: float) -> np.ndarray:
    """Rotation matrix of a quaternion, its scalar first."""
    return np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d],
        ]
    )


class Pendulum(NamedTuple):
    """The rigid part of a craft with a sloshing liquid, and the mass that swings; vectors in B."""

    rigid: float
    """Mass of the rigid part, kg."""
    mass: float
    """Mass that swings, kg."""
    inertia: np.ndarray
    """Of the rigid part about its own centre, kg m^2."""
    origin: np.ndarray
    """From the rigid part's centre to B's origin, m."""
    hinge: np.ndarray
    """From the rigid part's centre to the hinge, m."""
    length: float
    """Length of the rod, m."""
    damping: float
    """Friction of the hinge, N m s."""


class SwingingOracle(Oracle):
    """One flight of a craft in which a mass swings on a massless rod.

    Newton's equations of the rigid part and of the mass, Euler's of the rigid part and of each rotor, and a rod
    of constant length are solved as one linear system for the accelerations of both, w', the rotors' s', and the
    tension. The state has the rigid part's centre in place of B's origin, and after the rotors the rod's unit
    vector in B and its derivative as seen from B.
    """

    def __init__(self, flight: Flight, drawn: EpisodeParameters | None, number: int) -> None:
        super().__init__(flight, drawn, number)
        slosh: Any = self.craft.further_effectors[0]
        mass = self.mass * self.swings * slosh.mass / self.craft.mass
        rigid = self.mass - mass
        hinge = np.array(slosh.hinge) - self.centre
        resting = hinge + slosh.length * np.array(slosh.direction)
        # At rest both have their common centre in B's origin, and together the inertia of the craft.
        origin = resting * (mass / rigid)
        inertia = self.inertia.copy()
        for part, arm in ((mass, resting), (rigid, origin)):
            inertia -= part * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        if self.craft.dimension == 2:
            inertia = np.diag([1.0, 1.0, inertia[2, 2]])
        damping = self.sticks * slosh.damping
        self.pendulum = Pendulum(
            rigid, mass, inertia, origin, hinge + origin, slosh.length, damping
        )

    def _begun(self) -> np.ndarray:
        y = super()._begun()
        rotors = len(self.rotors)
        stores = [float(x[0, self.number]) for x in self.flight.states.stores[rotors:]]
        if self.craft.dimension == 3:
            rod = stores
        else:
            slosh: Any = self.craft.further_effectors[0]
            x, z, _ = slosh.direction
            angle, rate = stores
            c, s = math.cos(angle), math.sin(angle)
            along = np.array([c * x - s * z, s * x + c * z, 0.0])
            rod = [*along, *(rate * np.array([-along[1], along[0], 0.0]))]
        turn = Rotation.from_quat(y[[4, 5, 6, 3]])
        y[:3] -= turn.apply(self.pendulum.origin)
        y[7:10] -= turn.apply(np.cross(y[10:13], self.pendulum.origin))
        return np.array([*y[: 14 + rotors], *rod])

    def _columns(self, y: np.ndarray) -> list[float]:
        y = y.copy()
        turn = Rotation.from_quat(y[[4, 5, 6, 3]])
        y[:3] += turn.apply(self.pendulum.origin)
        y[7:10] += turn.apply(np.cross(y[10:13], self.pendulum.origin))
        rod = y[14 + len(self.rotors) :]
        if self.craft.dimension == 3:
            return [*super()._columns(y), *rod]
        slosh: Any = self.craft.further_effectors[0]
        x, z, _ = slosh.direction
        angle = math.atan2(x * rod[1] - z * rod[0], x * rod[0] + z * rod[1])
        return [*super()._columns(y), angle, rod[0] * rod[4] - rod[1] * rod[3]]

    def _carried(
        self, y: np.ndarray, duration: float, load: Any, flows: Any, motors: np.ndarray, pull: Any
    ) -> np.ndarray:
        rate = self._swinging(load, motors, pull, duration)
        return _integrated(rate, y, duration)

    def _swinging(self, load: Any, motors: np.ndarray, pull: Any, duration: float) -> Any:
        (force, torque), (more_force, more_torque) = load
        pull_force, pull_torque = pull
        one = self.pendulum
        count = len(self.rotors)
        gravity = self.gravity
        flat = self.craft.dimension == 2
        cross = np.cross
        # Columns: acceleration of the rigid part, w', the rod's second derivative seen from B, tension, s'.
        matrix = np.zeros((10 + count, 10 + count))
        matrix[:3, :3] = one.rigid * np.eye(3)
        matrix[3:6, :3] = one.mass * np.eye(3)
        matrix[3:6, 6:9] = one.mass * one.length * np.eye(3)
        matrix[6:9, 3:6] = one.inertia + (self.axes.T * self.rotors) @ self.axes
        matrix[6:9, 10:] = self.axes.T * self.rotors
        matrix[10:, 3:6] = (self.axes.T * self.rotors).T
        matrix[10:, 10:] = np.diag(self.rotors)

        def skew(v: np.ndarray) -> np.ndarray:
            return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])

        def rate(time: float, y: np.ndarray) -> np.ndarray:
            share = time / duration
            a, b, c, d = y[3:7]
            w = y[10:13]
            rod = y[14 + count : 17 + count]
            slip = y[17 + count : 20 + count]
            turn = Rotation.from_quat([b, c, d, a]).as_matrix()
            pushed = force + share * more_force + turn.T @ pull_force
            twisted = torque + share * more_torque + turn.T @ pull_torque
            falls = turn.T @ gravity
            reach = one.hinge + one.length * rod
            drag = -one.damping / one.length * slip
            momentum = one.inertia @ w + self.axes.T @ self._momenta(y)
            left = matrix.copy()
            left[:3, 9] = rod
            left[3:6, 3:6] = -one.mass * skew(reach)
            left[3:6, 9] = -rod
            left[6:9, 9] = cross(one.hinge, rod)
            left[9, 6:9] = rod
            right = np.concatenate(
                [
                    pushed - drag + one.rigid * falls,
                    drag
                    + one.mass
                    * (falls - cross(w, cross(w, reach)) - 2.0 * one.length * cross(w, slip)),
                    twisted
                    + cross(one.origin, pushed)
                    - cross(one.hinge, drag)
                    + one.damping * cross(rod, slip)
                    - cross(w, momentum),
                    [-slip @ slip],
                    motors,
                ]
            )
            if flat:  # what would leave the plane is held
                right[[2, 5, 6, 7]] = 0.0
                left[6:8] = 0.0
                left[6, 3] = left[7, 4] = 1.0
            solved = np.linalg.solve(left, right)
            turned = _turned((a, b, c, d), w)
            return np.array(
                [
                    *y[7:10],
                    *turned,
                    *(turn @ solved[:3]),
                    *solved[3:6],
                    0.0,
                    *solved[10:],
                    *slip,
                    *solved[6:9],
                ]
            )

        return rate
