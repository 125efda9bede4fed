"""Whole flights by equations of this file's own, for every effect together: SciPy's DOP853.

A craft is a rigid hub that carries rotors, a tank and a point mass on a massless rod. All of them have a momentum P
and an angular momentum L about the origin, in axes that do not turn. Velocity and spin follow from P and L at every
instant. Motors change the angular momenta of rotors along their axes. Propellant takes the momentum that it had in
the tank: P' = force - flow v and L' = moment - flow (x x v + k w), with the place x of the tank, its velocity v and
its moment of inertia k for each kilogram. The mass m on the rod l u has the velocity V and the angular momentum
h = m l u x V about a hinge of the velocity H, so that h' = m V x H + l u x force. Where gravity turns the craft it
pulls each part where it is, with the torque 3 n^2 r x I r, with the unit vector r away from the planet. The plane
is the same motion in space, with forces that lie in it. On an orbit states are in the Hill frame, which turns
with n.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rans.episode.flight import Flight
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
        self._divide()

    def _divide(self) -> None:
        """Masses, places and inertias of the parts, which at rest make up the craft about its centre."""
        craft = self.craft
        tank: Any = craft.propellant or Propellant(0.0, 1.0)
        self.exhaust = tank.specific_impulse * GRAVITY
        self.arm = np.zeros(3)
        self.round = self.inertia / self.mass
        if tank.position is not None:
            self.arm = np.array(tank.position) - self.centre
            self.round = 0.4 * tank.radius**2 * np.eye(3)
        slosh: Any = next(iter(craft.further_effectors), None)
        self.slosh = slosh
        self.swings = 0.0
        self.hinge = resting = np.zeros(3)
        if slosh is not None:
            self.swings = self.mass * slosh.mass / craft.mass
            self.hinge = np.array(slosh.hinge) - self.centre
            resting = self.hinge + slosh.length * np.array(slosh.direction)
        self.resting = self.swings * resting
        self.hub = self.mass - tank.mass - self.swings
        self.hub_arm = -(self.arm * tank.mass + self.resting) / self.hub
        self.hub_inertia = self.inertia - tank.mass * (self.round + _about(self.arm))
        self.hub_inertia -= self.hub * _about(self.hub_arm) + self.swings * _about(resting)
        if craft.dimension == 2:
            self.hub_inertia = np.diag([1.0, 1.0, self.hub_inertia[2, 2]])
        self.weighed = math.nan
        self.mobility: Any = None

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
        return y[14 : 14 + len(self.rotors)]

    def _begun(self) -> np.ndarray:
        """Position, attitude (w, x, y, z), P, L, propellant, momenta of rotors, u and h of the rod, and time."""
        columns = [float(x[0, self.number]) for x in leaves(self.flight.states)]
        if self.craft.dimension == 2:
            x, y, angle, *velocity, w = columns[:6]
            p = np.array([x, y, 0.0])
            attitude = (math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2))
            v = np.array([*velocity, 0.0])
            spin = np.array([0.0, 0.0, w])
            stores = columns[6:]
        else:
            p, attitude, v, spin = (np.array(columns[k:n]) for k, n in _SPATIAL)
            stores = columns[13:]
        left = stores.pop(0) if self.craft.propellant is not None else 0.0
        momenta = stores[: len(self.rotors)]
        turn = _matrix(*attitude)
        v = turn.T @ (v + _cross(self.turning, p))
        spin = spin + turn.T @ self.turning
        mass, first, second, inertia = self._whole(left)
        push = mass * v + _cross(spin, first)
        about = _cross(first, v) + (inertia + second) @ spin + self.axes.T @ momenta
        rest: list[float] = []
        if self.slosh is not None:
            rod, slip = self._rod(stores[len(momenta) :])
            length = self.slosh.length
            reach = self.hinge + length * rod
            carried = self.swings * (v + _cross(spin, reach) + length * slip)
            push = push + carried
            about = about + _cross(reach, carried)
            rest = [*(turn @ rod), *(turn @ _cross(length * rod, carried))]
        push = turn @ push
        about = turn @ about + _cross(p, push)
        return np.array([*p, *attitude, *push, *about, left, *momenta, *rest, 0.0])

    def _rod(self, stores: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """Unit vector of the rod and its derivative as seen from B."""
        if self.craft.dimension == 3:
            return np.array(stores[:3]), np.array(stores[3:])
        angle, rate = stores
        turn = _matrix(math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2))
        rod = turn @ self.slosh.direction
        return rod, _cross((0.0, 0.0, rate), rod)

    def _whole(self, left: float) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Mass of hub and tank, its moments about B's origin, and inertia about the parts' own centres."""
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
        push = turn.T @ y[7:10]
        about = turn.T @ (y[10:13] - _cross(y[:3], y[7:10])) - self.axes.T @ self._momenta(y)
        if self.slosh is None:
            solved = self.mobility @ np.array([*push, *about])
            return solved[:3], solved[3:]
        # Along the rod the mass moves as the hinge does, and across it as h says.
        rod, across = self._across(y, turn)
        about = about - _cross(self.hinge + self.slosh.length * rod, across)
        solved = self.mobility @ np.array([*(push - across), *about])
        along = np.array([*rod, *_cross(self.hinge, rod)])
        moved = self.mobility @ along
        resisted = self.swings * (along @ solved) / (1.0 + self.swings * (along @ moved))
        solved = solved - resisted * moved
        return solved[:3], solved[3:]

    def _across(self, y: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """In B the rod, and the momentum of its mass across it; rounding of its length would grow."""
        rod, h = (turn.T @ part for part in (y[-7:-4], y[-4:-1]))
        rod = rod / math.sqrt(rod @ rod)
        return rod, _cross(h, rod) / self.slosh.length

    def _swing(self, y: np.ndarray, turn: np.ndarray, v: Any, w: Any) -> tuple[np.ndarray, ...]:
        """In B the rod, the velocities of hinge and mass, and the rod's derivatives, of W and as seen from B."""
        rod, across = self._across(y, turn)
        hinge = v + _cross(w, self.hinge)
        mass = across / self.swings + rod * (rod @ hinge)
        turning = (mass - hinge) / self.slosh.length
        return rod, hinge, mass, turning, turning - _cross(w, rod)

    def _columns(self, y: np.ndarray) -> list[float]:
        """The state as a flight lists it."""
        turn = _matrix(*y[3:7])
        v, w = self._motion(y, turn)
        frame = Rotation.from_rotvec(self.turning * y[-1])
        p = frame.inv().apply(y[:3])
        speed = frame.inv().apply(turn @ v) - _cross(self.turning, p)
        attitude = frame.inv() * Rotation.from_quat(y[3:7], scalar_first=True)
        turned = attitude.as_quat(scalar_first=True)
        spin = w - attitude.inv().apply(self.turning)
        stores = [*([y[13]] if self.craft.propellant is not None else []), *self._momenta(y)]
        flat = self.craft.dimension == 2
        if self.slosh is not None:
            rod, *_, slip = self._swing(y, turn, v, w)
            c, s, _ = self.slosh.direction
            angle = math.atan2(c * rod[1] - s * rod[0], c * rod[0] + s * rod[1])
            stores += [angle, _cross(rod, slip)[2]] if flat else [*rod, *slip]
        if not flat:
            return [*p, *turned, *speed, *spin, *stores]
        angle = 2 * math.atan2(turned[3], turned[0])
        return [*p[:2], angle, *speed[:2], spin[2], *stores]

    def _carried(
        self, y: np.ndarray, duration: float, load: Any, flows: Any, motors: np.ndarray, pull: Any
    ) -> np.ndarray:
        """The state after a piece; where the tank runs empty, thrust ends."""
        gone = 0.0
        if self.craft.propellant is None:
            flows = (0.0, 0.0)
        elif y[13] <= 1e-13:
            load = np.zeros((2, 2, 3))
            flows = (0.0, 0.0)
        else:
            # The instant at which the tank is empty: left = (first t + change t^2 / (2 duration)) / speed.
            need = flows[0] + 0.5 * flows[1]
            if need * duration / self.exhaust > y[13]:
                a = 0.5 * flows[1] / duration
                b = flows[0]
                c = -y[13] * self.exhaust
                gone = 2 * -c / (b + math.sqrt(b * b - 4 * a * c))
        rate = self._rate(load, flows, motors, pull, duration)
        until = gone or duration
        y = solve_ivp(rate, (0.0, until), y, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
        y[3:7] /= math.hypot(*y[3:7])
        if gone and gone < duration:
            y[13] = 0.0
            return self._carried(y, duration - gone, load, flows, motors, pull)
        return y

    def _rate(self, load: Any, flows: Any, motors: Any, pull: Any, duration: float) -> Any:
        """Derivative of a state, as a function of time and state."""
        (force, torque), (more_force, more_torque) = load
        n = self.turning[2]

        def rate(time: float, y: np.ndarray) -> np.ndarray:
            share = time / duration
            turn = _matrix(*y[3:7])
            v, w = self._motion(y, turn)
            flow = (flows[0] + share * flows[1]) / self.exhaust
            mass, first, _, inertia = self._whole(y[13])
            tank = y[:3] + turn @ self.arm
            c, s = math.cos(n * y[-1]), math.sin(n * y[-1])
            frame = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            outwards = frame[:, 0]

            def falls(x: np.ndarray) -> np.ndarray:
                return self.gravity + n * n * (3.0 * outwards * (outwards @ x) - x)

            # Thrust acts where the nozzles are, and the disturbance at the centre of mass of a rod at rest.
            thrust = turn @ (force + share * more_force)
            push = frame @ pull[0]
            centre = y[:3] + turn @ (first + self.resting) / (mass + self.swings)
            leaving = turn @ (v + _cross(w, self.arm))
            forces = thrust + push - flow * leaving
            moments = _cross(y[:3], thrust) + turn @ (torque + share * more_torque)
            moments += _cross(centre, push) + frame @ pull[1]
            moments -= flow * (_cross(tank, leaving) + turn @ self.round @ w)
            parts: list[Any] = [(self.hub, y[:3] + turn @ self.hub_arm), (y[13], tank)]
            swung: list[float] = []
            if self.slosh is not None:
                rod, hinge, swinging, turning, slip = self._swing(y, turn, v, w)
                reach = self.slosh.length * rod
                place = y[:3] + turn @ (self.hinge + reach)
                parts.append((self.swings, place))
                about = _cross(swinging, hinge) + _cross(reach, turn.T @ falls(place))
                about = self.swings * about - self.slosh.damping * _cross(rod, slip)
                swung = [*(turn @ turning), *(turn @ about)]
            if self.tide:
                every = inertia + (self.axes.T * self.rotors) @ self.axes
                moments += self.tide * _cross(outwards, turn @ every @ turn.T @ outwards)
            else:  # all fall as their common centre does
                whole = sum(weight for weight, _ in parts)
                parts = [(whole, sum(weight * x for weight, x in parts) / whole)]
            for weight, x in parts:
                forces = forces + weight * falls(x)
                moments += _cross(x, weight * falls(x))
            turned = _turned(y[3:7], w)
            return np.array([*(turn @ v), *turned, *forces, *moments, -flow, *motors, *swung, 1.0])

        return rate


_SPATIAL = ((0, 3), (3, 7), (7, 10), (10, 13))
"""Columns of position, attitude, velocity and spin."""


def _cross(a: Any, b: Any) -> np.ndarray:
    """Vector product; NumPy's own takes ten times as long."""
    x, y, z = a
    u, v, w = b
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def _about(arm: np.ndarray) -> np.ndarray:
    """Moments of inertia of 1 kg at an arm."""
    return arm @ arm * np.eye(3) - np.outer(arm, arm)


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
