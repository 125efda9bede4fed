"""The judge: a Drake plant built from masses, inertia and thruster geometry, and none of our equations.

It imports nothing of RANS but descriptions: a spacecraft, its actuators, its body, its drift (a test reads the
imports). An error shared by the fast engine and the optimal controllers cannot be shared by their judge.

States are rows of plain arrays, for the frame B at the centre of mass:

- plane: ``[x, y, theta, v_x, v_y, w]``: p_WB (m), heading (rad, not wrapped), v_WB in W (m/s), w_WB (rad/s);
- space: ``[p_WB (3), q_WB as w x y z (4), v_WB in W (3), w_WB in B (3)]``. Drake does not renormalise the
  quaternion: its length drifts at rounding level.

Behind them stands what effectors hold, in the order of the craft's ``stores``: propellant left, kg, and the
absolute momentum of each reaction wheel about its axis, N m s. Commands are those of the thrusters, 0 to 1, then
those of the wheels, -1 to 1. `tests/reference/test_plant.py` reads its imports: nothing of ours may enter, least of
all equations.
"""

# Drake's stubs write NumPy's array types with their two parameters exchanged and leave ports untyped.

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant, Propeller, PropellerInfo
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Joint,
    MultibodyForces,
    PlanarJoint,
    QuaternionFloatingJoint,
    RevoluteJoint,
    SpatialInertia,
)
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Integrator

from rans.base.errors import ConfigError, positive
from rans.model.body import Body
from rans.model.drift import FREE, Drift
from rans.model.spacecraft import Spacecraft
from rans.reference.frames import CircularFrame, drake_frame
from rans.reference.further import DrakeMass, drake_effectors
from rans.reference.nozzles import Failure, Nozzles, Segment
from rans.reference.parts import (
    OrbitForces,
    centre_of_mass,
    designed,
    gravity,
    mounted,
    spatial_inertia,
    thrust_pose,
    wheel_inertia,
)

_WEIGHINGS = 2
"""Times that a craft is weighed anew in an integration step in which it uses propellant: errors of both fall
together where the step is halved. Of a craft with wheels whose tank is empty after 8 s it is 1e-8 rad off, and was
7e-8 with 16 in 0.2 s."""
_IN_A_RAMP = 8
"""Times at least while a thrust grows or falls, however short that is: errors fall with its square. A heading is
off by 1.7e-5 rad within 5 s with one, and by 5e-7 rad with eight, for a tank that is empty after 8 s."""


class Plant:
    """Spacecraft of one kind, side by side in one Drake simulation; they never touch.

    Each is a rigid body in the author's frame G; its mass sits off G's origin through its `SpatialInertia`,
    so that the shift to the centre of mass is Drake's work, not ours. One `Propeller` holds all thrusters.
    How far each nozzle's thrust has grown is a state of Drake's too, which moves at a rate of its own.
    Integration steps end where a valve switches, where a thruster fails, and where a thrust begins or ends to
    grow.

    A reaction wheel is a body of its own on a revolute joint with an actuator, and a mass that moves in the craft
    brings bodies and joints (`rans.reference.further.DrakeMass`). Propellant that is used makes the craft lighter
    in short steps of the integration, each with the mass in its middle.

    Motion is integrated with Runge-Kutta of order five at a *fixed* step: under error control Drake 1.51.1
    continues from stale kinematics after a rejected step, and a discrete plant is a first-order Euler scheme
    that may apply a new command one step late.

    Args:
        craft: what to build.
        count: N, how many to simulate together; one alone costs two to three times as much as each of many.
        max_step: longest integration step, s. At 0.01 s, 25 s of on/off thrust are accurate to some
            1e-12 m in the plane and 1e-9 m in space (`validation.study.dynamics` measures it).
        body: each value one number or (N,), B at the true centre of mass; None: as the craft was designed.
        drift: what pulls at all: nothing, Drake's own gravity, or the pseudo-forces of an orbit's frame.

    Raises:
        ConfigError: Drake refuses the mass properties, or does not know the drift.
    """

    def __init__(
        self,
        craft: Spacecraft,
        count: int = 1,
        max_step: float = 0.01,
        body: Body | None = None,
        drift: Drift = FREE,
    ) -> None:
        self.craft = craft
        self.count = count
        self._body = body or designed(craft)
        self._drift = drift
        self._frame = drake_frame(drift)
        if self._frame is None and craft.propellant is not None and craft.propellant.position:
            # Axes that do not turn: disturbances act at a centre of mass that moves in the craft.
            self._frame = CircularFrame(SimpleNamespace(mean_motion=0.0))
        self._nozzles = Nozzles.of(craft, self._body, count)
        self._further = drake_effectors(craft.mounted)
        self._masses = [one for one in self._further if isinstance(one, DrakeMass)]
        """Further effectors with masses that move in the craft."""
        self._orbit: OrbitForces | None = None
        self._held: np.ndarray = np.zeros(count, bool)
        """Craft on an uneven orbit that no effector turns and that stand in W: something that is not modelled holds
        them, and no pseudo-torque turns them."""
        self._angles = np.zeros(count)
        """Where targets are on their orbits at time 0, rad."""
        self._given = np.zeros((count, sum(len(effector.places()) for effector in self._further)))
        """What further effectors give at each of their places."""
        # The plant: bodies, joints, thrusters, wheels, then what drives them.
        builder = DiagramBuilder()
        self._plant = MultibodyPlant(time_step=0.0)
        builder.AddSystem(self._plant)
        if self._masses and not drift.in_straight_lines:
            raise ConfigError(
                f"Drake flies the mass that moves in {craft.name!r} in free flight and uniform gravity, got "
                f"{drift!r}."
            )
        self._plant.mutable_gravity_field().set_gravity_vector(gravity(drift))
        self._bodies = [
            self._plant.AddRigidBody(f"G{k}", self._rigid_inertia(k)) for k in range(count)
        ]
        self._frames = [
            self._plant.AddFrame(
                FixedOffsetFrame(
                    f"B of {body.name()}",
                    body.body_frame(),
                    RigidTransform(centre_of_mass(craft, self._body, k)),
                )
            )
            for k, body in enumerate(self._bodies)
        ]
        kind = PlanarJoint if craft.dimension == 2 else QuaternionFloatingJoint
        joints = [
            self._plant.AddJoint(kind(frame.name(), self._plant.world_frame(), frame))
            for frame in self._frames
        ]
        self._wheels = [
            [self._add_wheel(k, number) for number in range(craft.wheel_count)]
            for k in range(count)
        ]
        for mass in self._masses:
            mass.add(self._plant, craft, self._body, self._bodies)
        self._plant.Finalize()
        # Where each spacecraft's coordinates stand in Drake's vectors, (N, coordinates).
        self._position = np.array(
            [j.position_start() + np.arange(j.num_positions()) for j in joints]
        )
        self._velocity = np.array(
            [j.velocity_start() + np.arange(j.num_velocities()) for j in joints]
        )
        self._spins = np.array(
            [[joint.velocity_start() for joint in wheels] for wheels in self._wheels], dtype=int
        )
        # The diagram around the plant, and its simulator.
        self._propeller, self._thrust = self._add_thrusters(builder)
        if craft.wheels:
            builder.ExportInput(self._plant.get_actuation_input_port(), "motors")
        self._export_forces(builder)
        self._simulator = Simulator(builder.Build())
        ApplySimulatorConfig(
            SimulatorConfig(
                integration_scheme="runge_kutta5", use_error_control=False, max_step_size=max_step
            ),
            self._simulator,
        )
        self._context = self._simulator.get_mutable_context()
        self._plant_context = self._plant.GetMyMutableContextFromRoot(self._context)
        self._propeller_context = self._propeller.GetMyContextFromRoot(self._context)
        self._thrust_context = self._thrust.GetMyMutableContextFromRoot(self._context)
        # As designed, until a flight sets something else.
        self._disturb(np.zeros(self._velocity.shape))
        self._weigh(np.ones(count))
        self._set_angles(None)

    def set_max_step(self, step: float) -> None:
        """Integrate in steps of at most so many seconds from now on."""
        self._simulator.get_mutable_integrator().set_maximum_step_size(step)

    def wrenches(self, commands: np.ndarray) -> np.ndarray:
        """Force and torque about the centre of mass that commands (N, thrusters), 0 to 1, give, in B.

        Plane: (N, 3) as F_x, F_y, tau_z; space: (N, 6) as F, tau; N and N m.
        """
        # At rest with B along W, so that Drake's vectors in W are vectors in B.
        self._set(np.tile(self._rest(), (self.count, 1)), self._with_wheels(commands))
        forces = MultibodyForces(self._plant)
        port = self._propeller.get_spatial_forces_output_port()
        applied: Any = port.Eval(self._propeller_context)
        for force in applied:
            self._plant.get_body(force.body_index).AddInForce(
                self._plant_context, force.p_BoBq_B, force.F_Bq_W, self._plant.world_frame(), forces
            )
        return self._rows(self._plant.CalcGeneralizedForces(self._plant_context, forces))

    def thruster_wrenches(self) -> np.ndarray:
        """Force and torque of each thruster alone, fully open: (thrusters, 3 or 6) as `wrenches`."""
        rows = [
            self.wrenches(np.tile(alone, (self.count, 1)))[0]
            for alone in np.eye(self.craft.thruster_count)
        ]
        return np.reshape(rows, (self.craft.thruster_count, self.craft.degrees_of_freedom))

    def mass_matrix(self) -> np.ndarray:
        """Mass matrix at rest about the centre of mass, axes of B: (3, 3) or (6, 6).

        Rows and columns are ordered as in `wrenches`; kg, kg m (zero) and kg m^2.
        """
        self._set(
            np.tile(self._rest(), (self.count, 1)),
            np.zeros((self.count, self.craft.command_count)),
        )
        own = self._velocity[0]
        whole = self._plant.CalcMassMatrix(self._plant_context)
        matrix = whole[np.ix_(own, own)]
        if self.craft.wheels:
            # Of wheels that spin freely.
            spins = self._spins[0]
            coupling = whole[np.ix_(spins, own)]
            matrix = matrix - coupling.T @ np.linalg.solve(whole[np.ix_(spins, spins)], coupling)
        return matrix if self.craft.dimension == 2 else np.roll(matrix, (3, 3), axis=(0, 1))

    def accelerations(self, states: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Time derivatives of v_WB in W and of the angular velocity's components in B.

        Of states (N, width), see the module, under commands (N, thrusters), 0 to 1. Plane: (N, 3) in
        m/s^2, m/s^2, rad/s^2; space: (N, 6), m/s^2 (3) and rad/s^2 (3).
        """
        commands = self._with_wheels(commands)
        states = self._with_stores(states)
        self._set(states, commands)
        self._drive(commands, self._momenta(states), np.inf)
        port = self._plant.get_generalized_acceleration_output_port()
        accelerations: Any = port.Eval(self._plant_context)
        rows = self._rows(accelerations)
        if self.craft.dimension == 3:
            # The derivative of w_WB is the same vector seen from W and from B: w x w = 0.
            rows[:, 3:] = np.einsum("nji,nj->ni", self._rotations(), rows[:, 3:])
        return rows

    def advance(self, *arguments: Any, **options: Any) -> np.ndarray:
        """States (N, width) after the commands were held for a duration; arguments of `states_at_checks`."""
        return self.states_at_checks(*arguments, **options)[-1]

    def states_at_checks(
        self,
        states: np.ndarray,
        commands: np.ndarray,
        duration: float,
        disturbances: np.ndarray | None = None,
        nozzles: Nozzles | None = None,
        earlier: Sequence[np.ndarray] = (),
        failure: Failure | None = None,
        checks: int = 1,
        drift: Drift | None = None,
    ) -> np.ndarray:
        """States (checks, N, width) while the commands are held, the last ones after the duration.

        Args:
            states: (N, width), see the module.
            commands: (N, thrusters), 0 to 1.
            duration: s.
            disturbances: (N, 3 or 6), force and torque about the centre of mass, constant in W, ordered
                as in `wrenches`; N and N m. None: nothing but the thrusters acts.
            nozzles: what becomes of commands in this period; None: as the body says, and at once.
            earlier: commands of the periods before that may still be felt, the last one first.
            failure: thrusters that fail in this period; None: the nozzles stay as they are.
            checks: how many instants to return, evenly spaced.
            drift: what pulls from the start of the period, on an orbit along which it changes; None: the plant's
                own drift.

        Raises:
            ConfigError: the duration is not above 0, or the drift is of another orbit than the plant's.
        """
        positive("the duration of a period in Drake, s,", duration)
        # State, motors of wheels and disturbances at the start of the period.
        nozzles = nozzles or self._nozzles
        states = self._with_stores(states)
        self._set_angles(drift)
        self._set(states, commands, duration)
        self._drive(commands, self._momenta(states), duration)
        self._disturb(np.zeros(self._velocity.shape) if disturbances is None else disturbances)
        self._context.SetTime(0.0)
        self._simulator.Initialize()
        # Segments of constant thrust, at whose ends Drake stops, as it does at every check.
        commanded = [command[:, self.craft.thruster_commands] for command in (commands, *earlier)]
        results = []
        segments = nozzles.segments(self.craft.actuators, commanded, duration, failure)
        if self.craft.propellant is not None:
            segments = self._burned(segments, states[:, self._width], duration, checks)
        for end, thrust, rate in segments:
            self._open(thrust, rate)
            while (
                len(results) < checks - 1
                and (instant := duration * (len(results) + 1) / checks) <= end
            ):
                self._simulator.AdvanceTo(instant)
                results.append(self._get())
            self._simulator.AdvanceTo(end)
        results.append(self._get())
        return np.stack(results)

    def rollout(
        self, starts: np.ndarray, commands: np.ndarray, control_period: float
    ) -> np.ndarray:
        """States (T + 1, N, width), the starts first, under commands (T, N, thrusters) given beforehand.

        Each command is held for one control period, s.
        """
        states = [self._with_stores(np.array(starts, dtype=np.float64))]
        for command in commands:
            states.append(self.advance(states[-1], command, control_period))
        return np.array(states)

    def _add_wheel(self, k: int, number: int) -> Joint:
        """Wheel ``number`` of spacecraft number k as a body with a joint, and the motor that turns it."""
        wheel = self.craft.wheels[number]
        name = f"W{number} of G{k}"
        body = self._plant.AddRigidBody(name, wheel_inertia(self.craft, wheel))
        axis = np.array(wheel.axis)
        joint = RevoluteJoint(name, self._frames[k], body.body_frame(), axis)
        added = self._plant.AddJoint(joint)
        self._plant.AddJointActuator(name, added)
        return added

    def _add_thrusters(self, builder: DiagramBuilder) -> tuple[Propeller, Integrator]:
        """A Propeller pushes along its own z axis with thrust_ratio times what has grown.

        The input "rate" has, spacecraft by spacecraft, thrusters and then what further effectors push.
        """
        nozzles = [
            info
            for k, body in enumerate(self._bodies)
            for info in (
                *(
                    PropellerInfo(
                        body.index(), thrust_pose(t), thrust_ratio=t.force, moment_ratio=0.0
                    )
                    for t in mounted(self.craft, self._body, k)
                ),
                *(
                    PropellerInfo(body.index(), mounting.pose, mounting.force, mounting.torque)
                    for effector in self._further
                    for mounting in effector.places()
                ),
            )
        ]
        if (
            not nozzles
        ):  # wheels alone: one without force, since Drake's Integrator has no output of width 0
            nozzles = [PropellerInfo(self._bodies[0].index(), thrust_ratio=0.0, moment_ratio=0.0)]
        propeller = Propeller(nozzles)
        thrust = Integrator(len(nozzles))
        builder.AddSystem(propeller)
        builder.AddSystem(thrust)
        builder.Connect(
            self._plant.get_body_poses_output_port(), propeller.get_body_poses_input_port()
        )
        builder.Connect(
            propeller.get_spatial_forces_output_port(),
            self._plant.get_applied_spatial_force_input_port(),
        )
        builder.Connect(thrust.get_output_port(), propeller.get_command_input_port())
        builder.ExportInput(thrust.get_input_port(), "rate")
        return propeller, thrust

    def _export_forces(self, builder: DiagramBuilder) -> None:
        """The input for disturbances, through the orbit's pull where there is an orbit. Sets `_orbit`.

        Every Drake system that adds generalised forces is in one chain, whose begin is the input.
        """
        forces = self._plant.get_applied_generalized_force_input_port()
        if self._frame is None:
            for mass in self._masses:
                if (friction := mass.friction()) is None:
                    continue
                builder.AddSystem(friction)
                builder.Connect(self._plant.get_state_output_port(), friction.state)
                builder.Connect(friction.total, forces)
                forces = friction.others
            builder.ExportInput(forces, "disturbance")
            return
        orbit = OrbitForces(
            self._frame,
            self._position,
            self._velocity,
            self._spins,
            self._axes(),
            np.array([wheel.inertia for wheel in self.craft.wheels]),
            self._plant.num_positions(),
            self._plant.num_velocities(),
        )
        self._orbit = orbit
        builder.AddSystem(orbit)
        builder.Connect(self._plant.get_state_output_port(), orbit.state)
        builder.Connect(orbit.total, forces)
        builder.ExportInput(orbit.others, "disturbance")
        builder.ExportInput(orbit.masses, "masses")
        builder.ExportInput(orbit.inertias, "inertias")
        builder.ExportInput(orbit.centres, "centres")
        builder.ExportInput(orbit.angles, "angles")

    def _rest(self) -> np.ndarray:
        """At W's origin, B along W, no motion, full tank, wheels at rest."""
        # A quaternion of 1, 0, 0, 0.
        motion = np.zeros(6) if self.craft.dimension == 2 else np.eye(13)[3]
        return np.append(motion, [store.initial for store in self.craft.stores])

    @property
    def _width(self) -> int:
        """Numbers of a state before those that effectors hold."""
        return 6 if self.craft.dimension == 2 else 13

    def _with_wheels(self, commands: np.ndarray) -> np.ndarray:
        """Commands (N, commands), with zeros for the wheels where they are of thrusters alone."""
        missing = self.craft.command_count - commands.shape[1]
        return np.pad(commands, ((0, 0), (0, missing)))

    def _with_stores(self, states: np.ndarray) -> np.ndarray:
        """States (N, width), with a full tank and wheels at rest where they say nothing of them."""
        if states.shape[1] > self._width:
            return states
        stores = np.tile([store.initial for store in self.craft.stores], (len(states), 1))
        return np.hstack([states, stores.reshape(len(states), -1)])

    def _momenta(self, states: np.ndarray) -> np.ndarray:
        """Momenta of the wheels (N, wheels), N m s."""
        end = self._first_of_further(states)
        return states[:, end - self.craft.wheel_count : end]

    def _first_of_further(self, states: np.ndarray) -> int:
        """Column where what further effectors hold begins."""
        return states.shape[1] - sum(len(effector.stores) for effector in self.craft.mounted)

    def _axes(self) -> np.ndarray:
        """Axes of the wheels in B, (3, wheels)."""
        return np.array([wheel.axis for wheel in self.craft.wheels]).reshape(-1, 3).T

    def _drive(self, commands: np.ndarray, momenta: np.ndarray, duration: float) -> None:
        """Motors give the commanded torque (N, wheels), or what keeps momenta in limits for a duration (s).

        Signs are the motor's on the wheel; the craft gets the opposite by the joint, not by this code.
        """
        if not self.craft.wheels:
            return
        strongest, largest = np.array(
            [(wheel.max_torque, wheel.max_momentum) for wheel in self.craft.wheels]
        ).T
        torques = commands[:, self.craft.wheel_commands] * strongest
        if np.isfinite(duration):
            least = (-largest - momenta) / duration
            highest = (largest - momenta) / duration
            torques = np.clip(torques, least, highest)
        self._simulator.get_system().GetInputPort("motors").FixValue(self._context, torques.ravel())

    def _weigh(self, left: np.ndarray) -> None:
        """Give every spacecraft a share (N,) of its full mass and inertia.

        It changes the plant's context: to be called before every part in which mass is another.
        """
        if self.craft.propellant is not None:
            for k, body in enumerate(self._bodies):
                inertia = self._rigid_inertia(k, float(left[k]))
                body.SetSpatialInertiaInBodyFrame(self._plant_context, inertia)
        if self._orbit is not None:
            masses = left * np.broadcast_to(self._body.mass, self.count)
            wholes = [self._whole(k) for k in range(self.count)]
            centres = np.array([whole.get_com() for whole in wholes])
            inertias = np.array(
                [
                    whole.Shift(whole.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
                    for whole in wholes
                ]
            )
            inertias[self._held] = 0.0
            diagram = self._simulator.get_system()
            diagram.GetInputPort("masses").FixValue(self._context, masses)
            diagram.GetInputPort("inertias").FixValue(self._context, inertias.ravel())
            diagram.GetInputPort("centres").FixValue(self._context, centres.ravel())

    def fastest_inside(self, stores: np.ndarray) -> float:
        """Fastest motion of masses in the craft with these stores (N, stores), rad/s; 0 without such."""
        rates = (effector.fastest(own) for effector, own in self._with_own(stores))
        return max(rates, default=0.0)

    def _with_own(self, stores: np.ndarray) -> Iterator[tuple[Any, np.ndarray]]:
        """Further effectors, each with its stores of all, (N, stores)."""
        first = self._first_of_further(stores)
        for described, effector in zip(self.craft.mounted, self._further, strict=True):
            last = first + len(described.stores)
            yield effector, stores[:, first:last]
            first = last

    def _rigid_inertia(self, k: int, left: float = 1.0) -> SpatialInertia:
        """Mass properties of one spacecraft without what moves in it; see `spatial_inertia`."""
        moving = [mass.at_rest(self.craft, self._body, k) for mass in self._masses]
        return spatial_inertia(self.craft, self._body, k, left, moving)

    def _whole(self, k: int) -> SpatialInertia:
        """Mass properties of one spacecraft and its wheels about B's origin, in B."""
        parts = [
            self._bodies[k].index(),
            *(joint.child_body().index() for joint in self._wheels[k]),
        ]
        return self._plant.CalcSpatialInertia(self._plant_context, self._frames[k], parts)

    def _turning(self, time: float) -> np.ndarray:
        """Angular velocity of W at a time of a period, s, in the axes of every spacecraft, (N, 3) rad/s."""
        if self._orbit is None:
            return np.zeros((self.count, 3))
        rates = self._orbit.rates(self._angles, time)
        return np.einsum("nji,nj->ni", self._rotations(), rates)

    def _set_angles(self, drift: Drift | None) -> None:
        """Set the input with the angles of the targets on their orbits at time 0."""
        if self._frame is None:
            return
        angle = self._frame.angle(self._drift if drift is None else drift)
        angles = np.asarray(angle, dtype=np.float64).ravel()
        self._angles = np.broadcast_to(angles, self.count)
        self._simulator.get_system().GetInputPort("angles").FixValue(self._context, self._angles)

    def _share_of_mass(self, left: np.ndarray) -> np.ndarray:
        """Share of the full mass (N,) with so much propellant left, kg."""
        tank = self.craft.propellant
        if tank is None:
            return np.ones(self.count)
        return 1.0 - (tank.mass - left) / np.broadcast_to(self._body.mass, self.count)

    def _burned(
        self, segments: Iterable[Segment], left: np.ndarray, duration: float, checks: int
    ) -> Iterator[Segment]:
        """Segments cut into short steps, at checks and where a tank is empty, each with the mass in its middle set.

        What is left in the tanks at the end of the step is `_left`.
        """
        tank = self.craft.propellant
        assert tank is not None
        per_share = np.array([t.force for t in self.craft.thrusters]) / tank.exhaust_speed
        longest = self._simulator.get_integrator().get_maximum_step_size()
        left = left.copy()
        begin = 0.0
        # Short steps within each segment, in which mass is nearly constant.
        for end, thrust, rate in segments:
            steps = math.ceil(_WEIGHINGS * (end - begin) / longest - 1e-9)
            if np.any(rate):
                steps = max(steps, _IN_A_RAMP)
            instants = [duration * k / checks for k in range(1, checks)]
            edges = np.unique([*np.linspace(begin, end, 1 + steps), *np.clip(instants, begin, end)])
            for a, b in pairwise(edges):
                now = a
                while now < b:
                    lit = left[:, None] > 0.0
                    opened = np.where(lit, thrust + rate * (now - begin), 0.0)
                    growing = np.where(lit, rate, 0.0)
                    flow = opened @ per_share
                    change = growing @ per_share
                    lasts = _until_empty(left, flow, change)
                    stop = min(b, now + float(lasts.min()))
                    step = stop - now
                    used = step * (flow + 0.5 * step * change)
                    # The mass in the middle counts, and thrusts that give what they give the true one.
                    first = self._share_of_mass(left)
                    left = np.where(lasts <= step + 1e-12, 0.0, np.maximum(left - used, 0.0))
                    last = self._share_of_mass(left)
                    middle = 0.5 * (first + last)
                    self._weigh(middle)
                    self._left = left
                    burned = opened * (middle / first)[:, None]
                    ends = (opened + growing * step) * (middle / last)[:, None]
                    if step > 0.0:
                        yield Segment(stop, burned, (ends - burned) / step)
                    now = stop
            begin = end

    def _set(self, states: np.ndarray, commands: np.ndarray, duration: float = math.inf) -> None:
        """Put states (N, width) and commands (N, n) into the context, for a control period (s).

        It also sets what the period goes by: propellant that is left, and which craft are held.
        """
        states = self._with_stores(states)
        stores = states[:, self._width :]
        states = states[:, : self._width]
        q = np.zeros(self._plant.num_positions())
        v = np.zeros(self._plant.num_velocities())
        for effector, own in self._with_own(stores):
            if isinstance(effector, DrakeMass):
                effector.set(self._plant_context, q, v, own)
        spins = states[:, 5:] if self.craft.dimension == 2 else states[:, 10:]
        held = not (self._drift.steady or self.craft.turns or self._drift.gradient() is not None)
        self._held = np.full(self.count, held) & (np.abs(spins) < 1e-15).all(axis=1)
        self._left = np.zeros(self.count) if self.craft.propellant is None else stores[:, 0]
        if held or self.craft.propellant is not None:
            self._weigh(self._share_of_mass(self._left))
        if self.craft.dimension == 2:
            q[self._position] = states[:, :3]
            v[self._velocity] = states[:, 3:]
            self._plant.SetPositions(self._plant_context, q)
        else:
            q[self._position] = np.roll(states[:, :7], 4, axis=1)  # Drake: quaternion, position
            self._plant.SetPositions(self._plant_context, q)
            w_W = np.einsum("nij,nj->ni", self._rotations(), states[:, 10:])
            v[self._velocity] = np.concatenate([w_W, states[:, 7:10]], axis=1)
        if self.craft.wheels:
            # Of their absolute momentum, what the craft's spin and that of W give is not theirs to have.
            spins = states[:, 5:6] * np.eye(3)[2] if self.craft.dimension == 2 else states[:, 10:]
            spins = spins + self._turning(0.0)
            rotors = np.array([wheel.inertia for wheel in self.craft.wheels])
            v[self._spins] = self._momenta(stores) / rotors - spins @ self._axes()
        self._plant.SetVelocities(self._plant_context, v)
        opened = commands[:, self.craft.thruster_commands]
        self._begin_further(commands, stores, duration)
        self._open(self._nozzles.force_shares(opened), np.zeros(opened.shape))

    def _begin_further(self, commands: np.ndarray, stores: np.ndarray, duration: float) -> None:
        """Begin a control period (s) of further effectors by commands (N, n) and stores (N, stores).

        It sets `_begun` and `_given`, from which forces are until the next period.
        """
        commands = self._with_wheels(commands)
        first = self.craft.wheel_commands.stop
        bare = self._first_of_further(stores)
        self._begun = []
        """Each further effector with its commands and stores, and the length of the control period."""
        for described, effector in zip(self.craft.mounted, self._further, strict=True):
            last = first + len(described.commands)
            left = bare + len(described.stores)
            self._begun.append((effector, commands[:, first:last], stores[:, bare:left], duration))
            first = last
            bare = left
        if self._begun:
            self._given = np.hstack([effector.values(*begun) for effector, *begun in self._begun])

    def _open(self, thrust: np.ndarray, rate: np.ndarray) -> None:
        """Shares (N, n) of full force that nozzles give from now on, and how fast they change, 1/s."""
        if self._begun:
            thrust = np.hstack([thrust, self._given])
            rate = np.hstack([rate, np.zeros(self._given.shape)])
        if not thrust.size:
            thrust = rate = np.zeros(1)
        self._thrust.set_integral_value(self._thrust_context, thrust.ravel())
        self._simulator.get_system().GetInputPort("rate").FixValue(self._context, rate.ravel())

    def _disturb(self, disturbances: np.ndarray) -> None:
        """The joints stand at the centre of mass with a full tank: their generalised forces are wrenches in W.

        `OrbitForces` moves them to where a tank at a place moves this centre.
        """
        forces = np.zeros(self._plant.num_velocities())
        forces[self._velocity] = np.roll(
            disturbances, 0 if self.craft.dimension == 2 else 3, axis=1
        )
        self._simulator.get_system().GetInputPort("disturbance").FixValue(self._context, forces)

    def _get(self) -> np.ndarray:
        """Read the states (N, width) from the context, in the order of the module's head; it changes nothing."""
        q = self._plant.GetPositions(self._plant_context)[self._position]
        v = self._rows(self._plant.GetVelocities(self._plant_context))
        if self.craft.dimension == 2:
            rows = np.concatenate([q, v], axis=1)
            w_B = v[:, 2:] * np.eye(3)[2]
        else:
            w_B = np.einsum("nji,nj->ni", self._rotations(), v[:, 3:])
            rows = np.concatenate([np.roll(q, -4, axis=1), v[:, :3], w_B], axis=1)
        if self.craft.propellant is not None:
            rows = np.column_stack([rows, self._left])
        if self.craft.wheels:
            rotors = np.array([wheel.inertia for wheel in self.craft.wheels])
            spins = self._plant.GetVelocities(self._plant_context)[self._spins]
            w_B = w_B + self._turning(self._context.get_time())
            rows = np.hstack([rows, rotors * (w_B @ self._axes() + spins)])
        time = self._context.get_time()
        further = (
            effector.get(self._plant_context)
            if isinstance(effector, DrakeMass)
            else effector.stores_after(*begun, time)
            for effector, *begun in self._begun
        )
        return np.hstack([rows, *further])

    def _rows(self, generalised: np.ndarray) -> np.ndarray:
        """One row per spacecraft, translation first (Drake's floating joint puts rotation first)."""
        return np.roll(generalised[self._velocity], 0 if self.craft.dimension == 2 else 3, axis=1)

    def _rotations(self) -> np.ndarray:
        """R_WB of every spacecraft, (N, 3, 3)."""
        context = self._plant_context
        return np.array([f.CalcPoseInWorld(context).rotation().matrix() for f in self._frames])


def _until_empty(left: np.ndarray, flow: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Times (N,), s, in which flows, kg/s, that change steadily, kg/s^2, use up what is left, kg.

    Infinite where they never do, or nothing is left.
    """
    # The smaller root of change t^2 / 2 + flow t - left, in the form that no cancellation spoils.
    square = flow * flow + 2.0 * change * left
    below = flow + np.sqrt(np.maximum(square, 0.0))
    uses = (left > 0.0) & (square >= 0.0) & (below > 0.0)
    return np.where(uses, 2.0 * left / np.where(uses, below, 1.0), np.inf)
