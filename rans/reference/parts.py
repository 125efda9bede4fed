"""Parts of the reference plant: inertias, nozzles, and the pull of an orbit.

Like the plant it takes nothing of RANS but descriptions: values that say what there is, not how it moves.
"""

# Drake's stubs write NumPy's array types with their two parameters exchanged.

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import RotationalInertia, SpatialInertia
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from rans.base.errors import ConfigError
from rans.model.actuators import Wheel
from rans.model.body import Body
from rans.model.drift import Drift, FreeFlight, UniformGravity
from rans.model.spacecraft import Spacecraft, Thruster
from rans.reference.frames import FRAMES, DrakeFrame, drake_frame


def designed(craft: Spacecraft) -> Body:
    """The body of a spacecraft as its author describes it: read here, not by those who are judged."""
    tensor = np.array(craft.inertia)
    count = craft.thruster_count
    moments = (tensor[2, 2],) if craft.dimension == 2 else tuple(tensor[np.triu_indices(3)])
    return Body(craft.mass, moments, (0.0,) * craft.dimension, (1.0,) * count, (0.0,) * count)


_WHEEL_MASS = 1e-3
"""Mass of a wheel as a share of the craft's: only Drake wants one, as the wheel's stands in the craft's."""


def wheel_inertia(craft: Spacecraft, wheel: Wheel) -> SpatialInertia:
    """Thin disc of a reaction wheel at the craft's centre of mass, in a frame with G's axes and origin there."""
    axis = np.array(wheel.axis)
    tensor = 0.5 * wheel.inertia * (np.eye(3) + np.outer(axis, axis))
    return SpatialInertia.MakeFromCentralInertia(
        _WHEEL_MASS * craft.mass, np.zeros(3), _rotational(tensor)
    )


def centre_of_mass(craft: Spacecraft, body: Body, index: int) -> np.ndarray:
    """Centre of mass of one of many spacecraft, (3,) m, in G."""
    shift = np.zeros(3)
    for k, x in enumerate(body.centre):
        shift[k] = x if np.ndim(x) == 0 else x[index]
    return np.array(craft.centre_of_mass) + shift


def _rotational(tensor: np.ndarray) -> RotationalInertia:
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = tensor
    return RotationalInertia(xx, yy, zz, xy, xz, yz)


def spatial_inertia(
    craft: Spacecraft,
    body: Body,
    index: int,
    left: float,
    moving: Sequence[tuple[float, np.ndarray]],
) -> SpatialInertia:
    """Mass, centre of mass and inertia of the rigid part of one of many spacecraft, in the author's frame G.

    In the plane only the moment about z counts; the others are the craft's in the same proportion. Wheels are
    bodies of their own: their masses and the moments across their axes are taken off, and so are masses that move.

    Args:
        craft: as it is described.
        body: with a full tank, each value one number or (N,).
        index: of the spacecraft.
        left: share of the mass that is left when propellant is used.
        moving: masses that move in the craft, kg, with their positions at rest in G, (3,) m.

    Raises:
        ConfigError: Drake refuses them.
    """

    def own(values: Iterable[Any]) -> np.ndarray:
        return np.array([x if np.ndim(x) == 0 else x[index] for x in values])

    if craft.dimension == 2:
        moments = np.array(craft.inertia)[np.triu_indices(3)] * (
            own(body.inertia) / craft.inertia[2][2]
        )
    else:
        moments = own(body.inertia)
    full = own([body.mass])[0]
    tank = craft.propellant
    if tank is not None and tank.position is not None:
        # A full craft without a ball of what was burned, where the tank is.
        moving = [*moving, ((1.0 - left) * full, np.array(tank.position))]
        ball = 0.4 * (1.0 - left) * full * tank.radius**2
        moments = moments - ball * np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        left = 1.0
    xx, xy, xz, yy, yz, zz = left * moments
    mass = left * full
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    # Off goes what is a body of its own: wheels, then masses that move.
    for wheel in craft.wheels:
        axis = np.array(wheel.axis)
        tensor -= 0.5 * wheel.inertia * (np.eye(3) - np.outer(axis, axis))
        mass -= _WHEEL_MASS * craft.mass
    centre = centre_of_mass(craft, body, index)
    for swings, position in moving:
        # The rest of the craft balances the mass that moves, both at rest.
        to_mass = position - centre
        mass -= swings
        to_rest = -swings / mass * to_mass
        for part, arm in ((swings, to_mass), (mass, to_rest)):
            tensor -= part * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        centre = centre + to_rest
    try:
        return SpatialInertia.MakeFromCentralInertia(mass, centre, _rotational(tensor))
    except RuntimeError as error:
        reason = str(error).partition("\n")[0]
        raise ConfigError(
            f"spacecraft {craft.name!r}: Drake refuses its inertia {craft.inertia}: {reason}"
        ) from error


def thrust_pose(thruster: Thruster) -> RigidTransform:
    """Pose in G of a frame whose z axis is the thrust's direction."""
    R_GP = RotationMatrix.MakeFromOneVector(np.array(thruster.direction), axis_index=2)
    return RigidTransform(R_GP, np.array(thruster.position))


def mounted(craft: Spacecraft, body: Body, k: int) -> Iterator[Thruster]:
    """Thrusters of spacecraft number k in G, where they truly are by the errors of their mountings (m).

    G's origin is the author's, not the centre of mass.
    """
    for number, thruster in enumerate(craft.thrusters):
        if not body.mountings:
            yield thruster
            continue
        mounting = body.mountings[number]
        # Entries are one number, or one for each spacecraft; the plane has no third.
        offset, direction = (
            np.array([np.ravel(x)[k if np.size(x) > 1 else 0] for x in (*vector, 0.0)][:3])
            for vector in (mounting.offset, mounting.direction)
        )
        position = np.array(thruster.position) + offset
        yield replace(thruster, position=tuple(position), direction=tuple(direction))


def gravity(drift: Drift) -> np.ndarray:
    """The field for Drake's own gravity, (3,) m/s^2.

    Raises:
        ConfigError: Drake is not told how this drift pulls.
    """
    if isinstance(drift, UniformGravity):
        return np.append(drift.acceleration, 0.0)[:3]
    if not isinstance(drift, FreeFlight) and drake_frame(drift) is None:
        raise ConfigError(
            f"Drake knows free flight, uniform gravity and the drifts {', '.join(FRAMES)}, got {drift!r}: describe "
            "another in the group rans.drake_frames of a package's entry points."
        )
    return np.zeros(3)


_CROSSING = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2).reshape(3, 9)
"""Matrix of the cross product of each unit vector with others."""


class OrbitForces(LeafSystem):
    """Adds the pseudo-forces and pseudo-torques of a Hill frame to every spacecraft as it moves in this frame.

    With x radial, y along the track and z across, the frame's angular velocity w and the gradient G of gravity at
    the target, the forces are m (G p - w' x p - w x (w x p) - 2 w x v), and m times a drag. The same
    pseudo-accelerations of all parts of a body that turns with u relative to the frame add up to the torque
    -J w' - w x J w + tr(J) u x w - 2 u x J w, of a wheel with the momentum h relative to the body to h x w besides.
    If the drift says so, the gradient of gravity turns the craft too.
    What w, w' and G are on an orbit is said by its `DrakeFrame`. These forces and those of others act at the centre
    of mass, the motion of which is that of the joint's point unless a tank moves it.

    The input of masses (N,) is in kg, that of inertias (N, 3, 3) about the centre of mass with wheels that do not
    turn in kg m^2, that of centres of mass (N, 3) from the joints in B in m, that of angles of the targets
    at time 0 (N,) in rad (`DrakeFrame.angle`).

    Args:
        frame: of the orbit.
        places: where the coordinates of each spacecraft's joint stand among the plant's positions, (N, 3 or 7).
        speeds: where its velocities stand among the plant's velocities and generalised forces, (N, 3 or 6).
        spins: where the rates of its wheels stand there, (N, wheels).
        axes: of the wheels in B, (3, wheels).
        rotors: moments of inertia of the wheels, (wheels,) kg m^2.
        positions: number of the plant's positions.
        count: number of its velocities.
    """

    def __init__(
        self,
        frame: DrakeFrame,
        places: np.ndarray,
        speeds: np.ndarray,
        spins: np.ndarray,
        axes: np.ndarray,
        rotors: np.ndarray,
        positions: int,
        count: int,
    ) -> None:
        super().__init__()
        self._frame = frame
        self._positions = positions
        # Drake's planar joint has x, y and the angle, its floating joint the rotation first.
        self._planar = speeds.shape[1] == 3
        along = slice(0, 2) if self._planar else slice(-3, None)
        about = slice(2, 3) if self._planar else slice(0, 3)
        self._places, self._speeds = places[:, along], speeds[:, along]
        self._turns, self._turning = (
            places[:, 2:3] if self._planar else places[:, :4],
            speeds[:, about],
        )
        self._spins, self._axes, self._rotors = spins, axes, rotors
        self.state = self.DeclareVectorInputPort("state", positions + count)
        self.masses = self.DeclareVectorInputPort("masses", len(places))
        self.inertias = self.DeclareVectorInputPort("inertias", 9 * len(places))
        self.centres = self.DeclareVectorInputPort("centres", 3 * len(places))
        self.angles = self.DeclareVectorInputPort("angles", len(places))
        self.others = self.DeclareVectorInputPort("others", count)
        self.total = self.DeclareVectorOutputPort("total", count, self._pull)

    def _pull(self, context: Context, output: BasicVector) -> None:
        """Output of the system: generalised forces that act in a frame that turns, added to those of others.

        In W; it writes the output and changes nothing else.
        """
        state = np.array(self.state.Eval(context))
        total = np.array(self.others.Eval(context))
        masses = np.array(self.masses.Eval(context))
        angles = np.array(self.angles.Eval(context))
        dimension = self._places.shape[1]
        position, speed, spin = np.zeros((3, len(masses), 3))
        position[:, :dimension] = state[self._places]
        speed[:, :dimension] = state[self._positions + self._speeds]
        spin[:, -self._turning.shape[1] :] = state[self._positions + self._turning]
        attitude = self._attitudes(state[self._turns])
        arms = (attitude @ np.array(self.centres.Eval(context)).reshape(-1, 3, 1))[:, :, 0]
        position += arms
        turning = _crossing(spin)
        speed += (turning @ arms[:, :, None])[:, :, 0]
        rate, change, gradient = self._frame.motion(angles, context.get_time())
        turn = _crossing(rate)
        pull = ((gradient - _crossing(change) - turn @ turn) @ position[:, :, None])[:, :, 0]
        pull -= 2.0 * (turn @ speed[:, :, None])[:, :, 0]
        pull[:, 1] -= self._frame.drag
        total[self._speeds] += masses[:, None] * pull[:, :dimension]

        # Torques in W: of the whole craft, and along the axes of its wheels.
        inertia = np.array(self.inertias.Eval(context)).reshape(-1, 3, 3)
        inertia = attitude @ inertia @ attitude.transpose(0, 2, 1)
        across = -turn @ spin[:, :, None]
        torque = np.einsum("nii->n", inertia)[:, None, None] * across
        torque -= inertia @ change[:, :, None]
        torque -= (turn + 2.0 * turning) @ inertia @ rate[:, :, None]
        if len(self._rotors):
            axes = attitude @ self._axes
            speeds = state[self._positions + self._spins]
            torque -= turn @ axes @ (self._rotors * speeds)[:, :, None]
            along = axes.transpose(0, 2, 1) @ (across - change[:, :, None])
            total[self._spins] += self._rotors * along[:, :, 0]
        if self._frame.gravity_gradient:
            torque += _gravity_torques(inertia, gradient)[:, :, None]
        force = np.zeros((len(masses), 3))
        force[:, :dimension] = total[self._speeds]
        torque += _crossing(arms) @ force[:, :, None]
        total[self._turning] += torque[:, -self._turning.shape[1] :, 0]
        output.SetFromVector(total)

    def _attitudes(self, coordinates: np.ndarray) -> np.ndarray:
        """R_WB (N, 3, 3) of headings (N, 1), rad, or of quaternions (N, 4): 1 + 2 s [v]x + 2 [v]x [v]x."""
        if self._planar:
            half = 0.5 * coordinates
            coordinates = np.hstack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)])
        unit = coordinates / np.sqrt(np.sum(coordinates**2, axis=1, keepdims=True))
        vector = _crossing(unit[:, 1:])
        return np.eye(3) + 2.0 * (unit[:, :1, None] * vector + vector @ vector)

    def rates(self, angles: np.ndarray, time: float) -> np.ndarray:
        """Angular velocities of the frame (N, 3), rad/s, at a time, s, of angles at time 0."""
        return self._frame.motion(angles, time)[0]


def _gravity_torques(inertia: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Torques (N, 3) of gravity about centres of mass, N m: of the accelerations G s on all masses at s from there.

    With the second moments S of the mass, tr(I) / 2 - I, the sum of s x G s over the mass is the axial vector of
    S G.

    Args:
        inertia: moments of inertia in W, (N, 3, 3) kg m^2.
        gradient: G in W, (N, 3, 3) 1/s^2.
    """
    half = 0.5 * np.einsum("nii->n", inertia)
    product = (half[:, None, None] * np.eye(3) - inertia) @ gradient
    return np.stack(
        [
            product[:, 1, 2] - product[:, 2, 1],
            product[:, 2, 0] - product[:, 0, 2],
            product[:, 0, 1] - product[:, 1, 0],
        ],
        axis=1,
    )


def _crossing(vectors: np.ndarray) -> np.ndarray:
    """Matrices (N, 3, 3) of the cross products of vectors (N, 3) with others, without NumPy's slow `cross`."""
    return (vectors @ _CROSSING).reshape(-1, 3, 3)
