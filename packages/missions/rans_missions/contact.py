"""Docking with contact: a probe, a plate and latches in one Drake simulation, for the mission ``dock-port``.

The mission's own verdict is a set: a spacecraft is docked once its errors are within tolerances. Here the same
controllers fly with bodies that can touch. The spacecraft carries a probe with a round tip. The target carries a
plate in front of its port. Drake computes the point contact between them. Once the mission's verdict says "docked",
all valves are shut and latches close: springs and dampers that draw the spacecraft to its docked pose. A capture
fails if a latch is loaded beyond its strength, or if the spacecraft has not come to rest in the port.

Frames: W has its origin in the target's centre. B is at the spacecraft's centre of mass, D is the docked pose of B,
which rotates with the target. States are rows as in `rans.reference.plant`, and D is the docked pose;
`tests/test_contact.py` compares with that plant where nothing touches.
"""

# Drake's stubs write NumPy's array types with their two parameters exchanged and leave ports untyped.

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import AddContactMaterial, Box, ProximityProperties, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ContactModel,
    CoulombFriction,
    Propeller,
    PropellerInfo,
)
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    LinearBushingRollPitchYaw,
    PlanarJoint,
    QuaternionFloatingJoint,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder

from rans.extend import (
    Body,
    ConfigError,
    Controller,
    Scenario,
    Setup,
    Spacecraft,
    World,
    positive,
    step,
)
from rans.model.accuracy import chosen
from rans.randomization.parameters import StepInputs
from rans.reference.flight import rows_from_states, states_from_rows
from rans.reference.nozzles import Nozzles
from rans.reference.parts import designed, spatial_inertia, thrust_pose

_TARGET_MASS = 1e6
"""Mass of the target, kg: so large that a contact does not change its spin, as in the mission."""
_PLATE_THICKNESS = 0.02
"""m"""
_CONTACT_STEP = 1e-3
"""Integration step near the plate, s. The contact of a craft of 5 kg oscillates by 0.03 rad in it."""
_FREE_STEP = 1e-2
"""Integration step elsewhere, s."""
_NEAR = 0.1
"""Distance of the tip from the plate below which the shorter step is used, m."""
_LOOK = 5e-3
"""Interval at which contact forces and loads of the latches are read, s."""


@dataclass(frozen=True)
class CaptureSystem:
    """Probe, plate and latches of a docking port. All numbers are ours, for laboratory platforms of 5 to 20 kg.

    >>> CaptureSystem(strength=2.0).strength
    2.0
    """

    tip: float = 0.33
    """Distance of the probe's tip from the centre of mass, along the spacecraft's x axis, m."""
    tip_radius: float = 0.02
    """Radius of the probe's round tip, m."""
    plate_half_width: float = 0.1
    """Half the width of the target's square plate, m. Its face touches the tip of a docked spacecraft."""
    contact_stiffness: float = 1e4
    """Stiffness of tip and plate, N/m each. In contact they are springs in a row, which have half of it."""
    contact_dissipation: float = 10.0
    """Dissipation of Hunt and Crossley's contact model, s/m."""
    friction: float = 0.3
    """Coefficient of friction."""
    stiffness: float = 100.0
    """Stiffness of the latches along each axis, N/m."""
    damping: float = 40.0
    """Damping of the latches along each axis, N s/m."""
    turn_stiffness: float = 2.0
    """Stiffness of the latches about each axis, N m/rad."""
    turn_damping: float = 1.0
    """Damping of the latches about each axis, N m s/rad."""
    strength: float = 10.0
    """Force at which the latches open again, N."""
    turn_strength: float = 1.0
    """Torque at which the latches open again, N m."""


@dataclass(frozen=True)
class Capture:
    """What came of one docking, from `DockingPlant.capture`."""

    captured: bool
    """Whether the latches held and the spacecraft came to rest in the port."""
    load: float
    """Largest force of the latches, N."""
    turn_load: float
    """Largest torque of the latches, N m."""
    distance: float
    """Distance from the docked position in the end, m."""
    angle: float
    """Angle to the docked attitude in the end, rad."""
    speed: float
    """Speed relative to the port in the end, m/s."""


@dataclass(frozen=True)
class Docking:
    """What came of one flight to a port, from `fly_to_contact`."""

    docked: bool
    """The mission's own verdict."""
    time: float
    """Length of the flight, s."""
    touched: bool
    """Whether tip and plate touched before the verdict."""
    contact_speed: float
    """Speed of the tip towards the plate when they touched for the first time, m/s; 0: they did not touch."""
    contact_force: float
    """Largest contact force before the verdict, N."""
    capture: Capture | None
    """What came of the capture; None: not docked."""


def fly_to_contact(
    setup: Setup, controller: Controller, start: Scenario, system: CaptureSystem | None = None
) -> Docking:
    """Fly one episode of ``dock-port`` with bodies that can touch, and capture the spacecraft if it docks.

    Args:
        setup: craft, task and timing, under nominal conditions and without a safety filter.
        controller: who flies.
        start: one scenario, fields of shape (1,).
        system: probe, plate and latches.

    Raises:
        ConfigError: see `DockingPlant`.
    """
    craft = setup.craft
    if setup.conditions is not None:
        raise ConfigError("contact in Drake is for nominal conditions: leave conditions out.")
    setup = setup._replace(timing=chosen(craft, setup.timing, None))
    timing = setup.timing
    world = World(setup)
    docked_row = rows_from_states(start.goal)[0]
    # Drake moves both; the verdict is that of the engine's own step.
    plant = DockingPlant(craft, docked_row, timing.control_period, timing.checks, system)
    now = world.begin(start.start, start.goal, 0, None, Body.of(craft))
    controller.reset(1)
    done = False
    steps = 0
    for _ in range(timing.episode_steps):
        observation = np.stack(world.observe(now, None), axis=1).astype(np.float32)
        command = np.asarray(controller.act(world.sensed(now, None), now.goal, observation))
        outcome = step(world, now, tuple(command.astype(float).T), None, plant)
        now = outcome.episode
        steps += 1
        done = bool(np.all(outcome.done))
        if done or np.all(outcome.failed):
            break
    touched = plant.touched
    contact_speed = plant.contact_speed
    contact_force = plant.contact_force
    return Docking(
        done,
        steps * timing.control_period,
        touched,
        contact_speed,
        contact_force,
        plant.capture() if done else None,
    )


class DockingPlant:
    """One spacecraft and one target that can touch, in free flight.

    It is a `rans.episode.Mover` of a batch of one under nominal conditions. The target rotates at the port's rate.

    Args:
        craft: what docks. It has neither reaction wheels nor propellant.
        docked: docked state at the beginning, a row of numbers as in `rans.reference.plant`.
        control_period: s.
        checks: instants of a control period at which states are returned.
        system: probe, plate and latches.

    Raises:
        ConfigError: the spacecraft has reaction wheels or propellant, the control period is not above 0, or Drake
            refuses its inertia.
    """

    contact_force: float = 0.0
    """Largest contact force so far, N."""
    contact_speed: float = 0.0
    """Speed of the tip towards the plate when they touched for the first time, m/s."""
    touched: bool = False
    """Whether tip and plate have touched."""

    def __init__(
        self,
        craft: Spacecraft,
        docked: np.ndarray,
        control_period: float,
        checks: int = 1,
        system: CaptureSystem | None = None,
    ) -> None:
        if craft.stores:
            raise ConfigError(
                f"contact in Drake is for spacecraft without reaction wheels and propellant; "
                f"{craft.name} has them."
            )
        self.craft = craft
        self.system = system or CaptureSystem()
        positive("control_period", control_period)
        self._period = control_period
        self._checks = checks
        self._nozzles = Nozzles.of(craft, designed(craft), 1)
        X_TD, axis, rate = _port(docked, craft.dimension)
        builder = DiagramBuilder()
        self._plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        self._plant.set_contact_model(ContactModel.kPoint)
        self._plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))

        # The spacecraft, with its probe.
        craft_body = self._plant.AddRigidBody(
            "craft", spatial_inertia(craft, designed(craft), index=0)
        )
        self._frame_B = self._plant.AddFrame(
            FixedOffsetFrame(
                "B", craft_body.body_frame(), RigidTransform(np.array(craft.centre_of_mass))
            )
        )
        joint_kind = PlanarJoint if craft.dimension == 2 else QuaternionFloatingJoint
        self._joint = self._plant.AddJoint(
            joint_kind("free", self._plant.world_frame(), self._frame_B)
        )
        material = ProximityProperties()
        AddContactMaterial(
            dissipation=self.system.contact_dissipation,
            point_stiffness=self.system.contact_stiffness,
            friction=CoulombFriction(self.system.friction, self.system.friction),
            properties=material,
        )
        p_Tip = np.array([self.system.tip - self.system.tip_radius, 0.0, 0.0])
        self._plant.RegisterCollisionGeometry(
            craft_body,
            RigidTransform(np.array(craft.centre_of_mass) + p_Tip),
            Sphere(self.system.tip_radius),
            "probe",
            material,
        )

        # The target, with its plate and the docked pose.
        unit = UnitInertia.SolidSphere(1.0)
        target = self._plant.AddRigidBody("target", SpatialInertia(_TARGET_MASS, np.zeros(3), unit))
        self._spin = self._plant.AddJoint(
            RevoluteJoint("spin", self._plant.world_frame(), target.body_frame(), axis)
        )
        self._frame_D = self._plant.AddFrame(FixedOffsetFrame("D", target.body_frame(), X_TD))
        width = 2.0 * self.system.plate_half_width
        X_DPlate = RigidTransform(np.array([self.system.tip + 0.5 * _PLATE_THICKNESS, 0.0, 0.0]))
        self._plant.RegisterCollisionGeometry(
            target, X_TD @ X_DPlate, Box(_PLATE_THICKNESS, width, width), "plate", material
        )

        # Open latches are a bushing without stiffness and damping.
        nothing = np.zeros(3)
        self._latches = self._plant.AddForceElement(
            LinearBushingRollPitchYaw(
                self._frame_D, self._frame_B, nothing, nothing, nothing, nothing
            )
        )
        self._plant.Finalize()

        # Thrusters.
        propeller = Propeller(
            [
                PropellerInfo(
                    craft_body.index(),
                    thrust_pose(thruster),
                    thrust_ratio=thruster.force,
                    moment_ratio=0.0,
                )
                for thruster in craft.thrusters
            ]
        )
        builder.AddSystem(propeller)
        builder.Connect(
            self._plant.get_body_poses_output_port(), propeller.get_body_poses_input_port()
        )
        builder.Connect(
            propeller.get_spatial_forces_output_port(),
            self._plant.get_applied_spatial_force_input_port(),
        )
        builder.ExportInput(propeller.get_command_input_port(), "thrust")
        self._simulator = Simulator(builder.Build())
        ApplySimulatorConfig(
            SimulatorConfig(
                integration_scheme="runge_kutta3", use_error_control=False, max_step_size=_FREE_STEP
            ),
            self._simulator,
        )
        self._root = self._simulator.get_mutable_context()
        self._context = self._plant.GetMyMutableContextFromRoot(self._root)
        self._spin.set_angular_rate(self._context, rate)
        self._open(np.zeros(len(craft.thrusters)))
        self._simulator.Initialize()

    def __call__(self, state: Any, step_inputs: StepInputs) -> tuple[Any, ...]:
        """States (1,) at the checks of one control period, the last one at its end.

        Raises:
            ConfigError: there are disturbances, faults or slow valves.
        """
        if (step_inputs.disturbance, step_inputs.failing) != (None, None) or len(
            step_inputs.commands
        ) > 1:
            raise ConfigError("contact in Drake is for nominal conditions: leave conditions out.")
        command = [float(np.ravel(value)[0]) for value in step_inputs.commands[0]]
        rows = self.states_at_checks(rows_from_states(state)[0], np.array(command))
        return tuple(states_from_rows(row[None], state).normalised() for row in rows)

    def states_at_checks(self, row: np.ndarray, command: np.ndarray) -> np.ndarray:
        """States (checks, width) of one control period.

        Args:
            row: state at its beginning, (width,), as in `rans.reference.plant`.
            command: commands of the thrusters, (thrusters,), 0 to 1.
        """
        self._set(row)
        begin = self._root.get_time()
        instants = [
            begin + self._period * (number + 1) / self._checks for number in range(self._checks)
        ]
        seen = []
        segments = self._nozzles.segments(
            self.craft.actuators, [np.asarray(command, dtype=float)[None]], self._period
        )
        for end, thrust, _ in segments:
            self._open(thrust[0])
            while instants and instants[0] <= begin + end + 1e-12:
                self._advance_to(instants.pop(0))
                seen.append(self.state())
            self._advance_to(begin + end)
        return np.array(seen)

    def capture(self, seconds: float = 20.0) -> Capture:
        """Shut all valves, close the latches, and simulate for some seconds.

        "At rest" means within 2 mm, 0.5 degrees and 1 mm/s of the docked pose. A load beyond the strength of the
        latches counts as a failure, and the simulation goes on as if they held.
        """
        system = self.system
        self._open(np.zeros(len(self.craft.thrusters)))
        latches = self._latches
        latches.SetForceStiffnessConstants(self._context, np.full(3, system.stiffness))
        latches.SetForceDampingConstants(self._context, np.full(3, system.damping))
        latches.SetTorqueStiffnessConstants(self._context, np.full(3, system.turn_stiffness))
        latches.SetTorqueDampingConstants(self._context, np.full(3, system.turn_damping))
        load = 0.0
        turn_load = 0.0
        end = self._root.get_time() + seconds
        while self._root.get_time() < end - 1e-12:
            force = latches.CalcBushingSpatialForceOnFrameA(self._context)
            load = max(load, float(np.linalg.norm(force.translational())))
            turn_load = max(turn_load, float(np.linalg.norm(force.rotational())))
            self._advance_to(min(end, self._root.get_time() + _LOOK))
        X_DB = self._frame_B.CalcPose(self._context, self._frame_D)
        V_DB = self._frame_B.CalcSpatialVelocity(self._context, self._frame_D, self._frame_D)
        distance = float(np.linalg.norm(X_DB.translation()))
        angle = abs(float(X_DB.rotation().ToAngleAxis().angle()))
        speed = float(np.linalg.norm(V_DB.translational()))
        held = load <= system.strength and turn_load <= system.turn_strength
        at_rest = distance <= 2e-3 and angle <= math.radians(0.5) and speed <= 1e-3
        return Capture(held and at_rest, load, turn_load, distance, angle, speed)

    def _advance_to(self, end: float) -> None:
        """Simulate until a time, s, and keep the largest contact force and the speed of the first contact."""
        while self._root.get_time() < end - 1e-12:
            gap, closing = self._gap()
            step = _CONTACT_STEP if gap < _NEAR else _FREE_STEP
            self._simulator.get_mutable_integrator().set_maximum_step_size(step)
            self._simulator.AdvanceTo(min(end, self._root.get_time() + _LOOK))
            contacts = self._plant.get_contact_results_output_port().Eval(self._context)
            for number in range(contacts.num_point_pair_contacts()):
                force = contacts.point_pair_contact_info(number).contact_force()
                self.contact_force = max(self.contact_force, float(np.linalg.norm(force)))
                if not self.touched:
                    self.contact_speed = closing
                    self.touched = True

    def _gap(self) -> tuple[float, float]:
        """Distance of the tip from the plate's face, m, and the speed at which it falls, m/s."""
        X_DB = self._frame_B.CalcPose(self._context, self._frame_D)
        V_DB = self._frame_B.CalcSpatialVelocity(self._context, self._frame_D, self._frame_D)
        p_Centre = np.array([self.system.tip - self.system.tip_radius, 0.0, 0.0])
        p_BCentre_D = X_DB.rotation() @ p_Centre
        ahead = X_DB.translation()[0] + p_BCentre_D[0]
        velocity = V_DB.translational() + np.cross(V_DB.rotational(), p_BCentre_D)
        return self.system.tip - self.system.tip_radius - float(ahead), float(velocity[0])

    def _open(self, thrust: np.ndarray) -> None:
        """Let thrusters push with shares of their full force from now on."""
        port: Any = self._simulator.get_system().GetInputPort("thrust")
        port.FixValue(self._root, thrust)

    def _set(self, row: np.ndarray) -> None:
        """Put a state, a row as in `rans.reference.plant`, into the joint between world and craft.

        Drake's joint has its angular velocity in W, the row's is in B; `state` turns it back.
        """
        if self.craft.dimension == 2:
            self._joint.set_translation(self._context, row[0:2])
            self._joint.set_rotation(self._context, row[2])
            self._joint.set_translational_velocity(self._context, row[3:5])
            self._joint.set_angular_velocity(self._context, row[5])
            return
        R_WB = RotationMatrix(_quaternion(row[3:7]))
        self._joint.SetPose(self._context, RigidTransform(R_WB, row[0:3]))
        self._joint.set_translational_velocity(self._context, row[7:10])
        self._joint.set_angular_velocity(self._context, R_WB @ row[10:13])

    def state(self) -> np.ndarray:
        """Present state of the craft, a row as in `rans.reference.plant` (SI, quaternion w first)."""
        if self.craft.dimension == 2:
            return np.array(
                [
                    *self._joint.get_translation(self._context),
                    self._joint.get_rotation(self._context),
                    *self._joint.get_translational_velocity(self._context),
                    self._joint.get_angular_velocity(self._context),
                ]
            )
        X_WB = self._joint.GetPose(self._context)
        w_WB = X_WB.rotation().inverse() @ self._joint.get_angular_velocity(self._context)
        return np.array(
            [
                *X_WB.translation(),
                *X_WB.rotation().ToQuaternion().wxyz(),
                *self._joint.get_translational_velocity(self._context),
                *w_WB,
            ]
        )


def _quaternion(wxyz: np.ndarray) -> Quaternion:
    return Quaternion(wxyz / np.linalg.norm(wxyz))


def _port(docked: np.ndarray, dimension: int) -> tuple[RigidTransform, np.ndarray, float]:
    """Pose of D in the target's frame from the docked row, and unit axis (3,) and rate (rad/s) of its spin."""
    if dimension == 2:
        R_WD = RotationMatrix.MakeZRotation(docked[2])
        return (
            RigidTransform(R_WD, np.array([*docked[0:2], 0.0])),
            np.array([0.0, 0.0, 1.0]),
            float(docked[5]),
        )
    R_WD = RotationMatrix(_quaternion(docked[3:7]))
    w_WD = R_WD @ docked[10:13]
    rate = float(np.linalg.norm(w_WD))
    axis = w_WD / rate if rate > 0.0 else np.array([0.0, 0.0, 1.0])
    return RigidTransform(R_WD, docked[0:3]), axis, rate
