"""Basilisk: craft with thrusters, wheels, liquid and the gradient of gravity, under commands of chance.

It is the simulator of the University of Colorado (AVSLab/basilisk, `bsk` of the package index). Where it is
installed it flies the cases anew. Else its figures are those of basilisk.json, which it wrote:

    python -m rans_missions.judges.basilisk
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rans.extend import (
    TASKS,
    Quat,
    Scenario,
    Spacecraft,
    SpatialState,
    Timing,
    Vec3,
    fly,
    is_installed,
    load_spacecraft,
    map_leaves,
    read_json,
    write_json,
)
from rans_missions.script import Script
from rans_missions.slosh.liquid import Slosh
from validation.judges.judge import Judge, Largest, Row
from validation.study.checks import Check

BASILISK_STATES = Path(__file__).with_suffix(".json")
"""File of its states after every tenth period, by case."""
_STEP = 0.002
"""Basilisk's steps of fourth order, s; they divide every pulse. 10 ms differ by 7e-10 m, 2 ms by 1e-12."""
_RADIUS = 7e9
"""Distance of the planet from the target, m: so far that its gradient is the same wherever the craft flies."""
_OPEN = 0.06
"""Part of the thrusters that fire in a period: with more the craft would spin beyond what tasks have."""

BASILISK = Judge(
    "Basilisk 2.12.1",
    "AVSLab/basilisk, bsk of the package index",
    "2.12.1",
    "Other people wrote it, in C++ and by another method: masses that move are back-substituted into the equations "
    "of the hub, attitudes are modified Rodrigues parameters, and the axes do not turn.",
)
_RIGID = "Rounding and Basilisk's own steps."
_SWINGS = "Our steps are of order four where a mass swings."


@dataclass(frozen=True)
class Case:
    """A flight."""

    about: str
    craft: Spacecraft
    period: float
    """Control period, s."""
    steps: int = 50
    """Control periods."""
    mean_motion: float = 0.0
    """Mean motion of its orbit, rad/s, on which the gradient of gravity turns the craft; 0: there is no gravity."""

    @property
    def bound(self) -> float:
        """Largest difference that is accepted, m, rad and rad/s."""
        return 1e-5 if self.craft.further_effectors else 1e-8

    def start(self) -> SpatialState:
        """A craft that turns about all axes, on an orbit where the target is."""
        spin = Vec3(0.11, -0.07, 0.05)
        still = Vec3(0.0, 0.0, 0.0)
        return SpatialState(still, Quat(0.5, -0.1, 0.7, 0.5).normalised(), still, spin)

    def commands(self) -> np.ndarray:
        """Commands (T, commands): few thrusters at a time, and wheels up to half of their torque."""
        random = np.random.default_rng(2026)
        size = (self.steps, len(self.craft.thrusters))
        widths = 1.0
        if self.craft.actuators.is_continuous:
            widths = random.integers(1, 5, size) / 4.0
        thrust = (random.random(size) < _OPEN) * widths
        torque = random.uniform(-0.5, 0.5, (self.steps, len(self.craft.wheels)))
        return np.hstack([thrust, torque])


def cases() -> dict[str, Case]:
    """All cases by their names."""
    flyer = load_spacecraft("free-flyer")
    cube = load_spacecraft("cubesat-3u")
    # A sixth of the mass swings; the inertia is one of an uneven craft.
    liquid = Slosh(0.8, 0.05, (0.03, -0.02, 0.04), (-0.48, 0.6, 0.64), 0.004)
    uneven = ((0.15, 0.01, -0.005), (0.01, 0.12, 0.015), (-0.005, 0.015, 0.2))
    wet = replace(flyer, name="wet", inertia=uneven, further_effectors=(liquid,))
    wheels = tuple(replace(wheel, max_torque=0.01) for wheel in cube.wheels)
    return {
        "thrusters": Case("free flyer, 16 valves", flyer, 0.2),
        "wheels": Case("CubeSat, pulses of 10 ms and three wheels", cube, 0.5),
        "gradient": Case("the same, turned by gravity at 0.03 rad/s", cube, 0.5, 40, 0.03),
        "slosh": Case("liquid that swings, 15 % of the mass", wet, 0.2),
        "slosh, wheels": Case("the same with wheels", replace(wet, wheels=wheels), 0.2),
    }


def ours(case: Case) -> np.ndarray:
    """Our states after each period (T, 13): p, v in axes that do not turn, spin in B, quaternion (x, y, z, w)."""
    task = TASKS["go-to-pose"](fail_distance=1e6, fail_spin=1e6)
    if case.mean_motion:
        task = TASKS["go-to-attitude"](mean_motion=case.mean_motion, fail_spin=1e6)
    start = map_leaves(lambda x: np.array([x]), case.start())
    # The equations are judged, not the default steps, which are for agents (docs/dynamics.md): 5e-8 rad here.
    timing = Timing(control_period=case.period, episode_steps=case.steps, substeps=8)
    commands = Script(case.commands()[:, None])
    states = fly(case.craft, task, commands, Scenario(start, start), timing).states
    times = case.period * np.arange(1, case.steps + 1)
    turned = Rotation.from_rotvec(np.outer(times, [0.0, 0.0, case.mean_motion]))
    p, v, w = (np.stack(x.columns(), axis=-1)[1:, 0] for x in (states.p, states.v, states.w))
    q = states.attitude
    attitude = Rotation.from_quat(np.stack([q.x, q.y, q.z, q.w], axis=-1)[1:, 0])
    rate = np.array([0.0, 0.0, case.mean_motion])
    spin = w + attitude.inv().apply(rate)
    speed = turned.apply(v + np.cross(rate, p))
    return np.hstack([turned.apply(p), speed, spin, (turned * attitude).as_quat()])


def theirs(case: Case) -> np.ndarray:
    """Basilisk's states, as `ours`."""
    from Basilisk.architecture import messaging  # pyrefly: ignore[missing-import]
    from Basilisk.simulation import (  # pyrefly: ignore[missing-import]
        GravityGradientEffector,
        reactionWheelStateEffector,
        spacecraft,
        sphericalPendulum,
        svIntegrators,
        thrusterDynamicEffector,
    )
    from Basilisk.utilities import (  # pyrefly: ignore[missing-import]
        SimulationBaseClass,
        macros,
        simIncludeGravBody,
    )

    def column(vector: Any) -> list[list[float]]:
        return np.reshape(vector, (3, 1)).tolist()

    craft = case.craft
    sim = SimulationBaseClass.SimBaseClass()
    sim.CreateNewProcess("all").addTask(sim.CreateNewTask("all", macros.sec2nano(_STEP)))
    body = spacecraft.Spacecraft()
    body.setIntegrator(svIntegrators.svIntegratorRK4(body))
    sim.AddModelToTask("all", body, 1)

    begun = case.start()
    q = begun.attitude
    attitude = Rotation.from_quat([q.x, q.y, q.z, q.w])
    rate = np.array([0.0, 0.0, case.mean_motion])
    spin = begun.w.columns() + attitude.inv().apply(rate)

    # The hub: what neither swings nor, about its own axis, is a wheel's.
    centre = np.array(craft.centre_of_mass)
    mass = craft.mass
    offset = np.zeros(3)
    inertia = np.array(craft.inertia)
    liquids: Any = craft.further_effectors
    for liquid in liquids:
        hinge = np.array(liquid.hinge) - centre
        mass -= liquid.mass
        at_rest = hinge + liquid.length * np.array(liquid.direction)
        offset = -liquid.mass / mass * at_rest
        for part, arm in ((liquid.mass, at_rest), (mass, offset)):
            inertia -= part * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        swinging = sphericalPendulum.SphericalPendulum()
        swinging.massInit = liquid.mass
        swinging.pendulumRadius = liquid.length
        swinging.d = column(hinge)
        # Its angles are 0 along the first axis.
        axes = np.linalg.qr(np.column_stack([liquid.direction, np.eye(3)[:, :2]]))[0]
        axes[:, 0] = liquid.direction
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
        swinging.pHat_01, swinging.pHat_02, swinging.pHat_03 = map(column, axes.T)
        swinging.D = (liquid.damping / liquid.length**2 * np.eye(3)).tolist()
        body.addStateEffector(swinging)
        sim.AddModelToTask("all", swinging, 4)
    for wheel in craft.wheels:  # Basilisk's hub has their axial inertia, ours has not
        inertia += wheel.inertia * np.outer(wheel.axis, wheel.axis)
    body.hub.mHub = mass
    body.hub.r_BcB_B = column(offset)
    body.hub.IHubPntBc_B = inertia.tolist()

    # Thrusters and wheels.
    thrusters = thrusterDynamicEffector.ThrusterDynamicEffector()
    for thruster in craft.thrusters:
        nozzle = thrusterDynamicEffector.THRSimConfig()
        nozzle.MaxThrust = thruster.force
        nozzle.MinOnTime = 0.0
        nozzle.steadyIsp = 300.0  # without a tank nothing depends on it
        nozzle.thrLoc_B = column(np.array(thruster.position) - centre)
        nozzle.thrDir_B = column(thruster.direction)
        thrusters.addThruster(nozzle)
    body.addDynamicEffector(thrusters)
    sim.AddModelToTask("all", thrusters, 2)
    on_times = messaging.THRArrayOnTimeCmdMsg()
    thrusters.cmdsInMsg.subscribeTo(on_times)
    torques = messaging.ArrayMotorTorqueMsg()
    if craft.wheels:
        motors = reactionWheelStateEffector.ReactionWheelStateEffector()
        for wheel in craft.wheels:
            rotor = reactionWheelStateEffector.RWConfigPayload()
            rotor.RWModel = messaging.BalancedWheels
            rotor.Js = wheel.inertia
            rotor.gsHat_B = column(wheel.axis)
            rotor.Omega = float(
                -(spin @ wheel.axis)
            )  # at rest in axes that do not turn, as ours begin
            rotor.u_max = rotor.Omega_max = rotor.P_max = rotor.betaStatic = -1.0  # no limits
            motors.addReactionWheel(rotor)
        body.addStateEffector(motors)
        sim.AddModelToTask("all", motors, 3)
        motors.rwMotorCmdInMsg.subscribeTo(torques)

    # Where it starts, with the planet where an orbit asks for one.
    origin = np.array([_RADIUS, 0.0, 0.0])
    body.hub.sigma_BNInit = attitude.as_mrp().tolist()
    body.hub.omega_BN_BInit = spin.tolist()
    body.hub.r_CN_NInit = np.zeros(3).tolist()
    if case.mean_motion:
        gravity = simIncludeGravBody.gravBodyFactory()
        planet = gravity.createCustomGravObject("planet", case.mean_motion**2 * _RADIUS**3)
        planet.isCentralBody = True
        gravity.addBodiesTo(body)
        gradient = GravityGradientEffector.GravityGradientEffector()
        gradient.addPlanetName(planet.planetName)
        body.addDynamicEffector(gradient)
        sim.AddModelToTask("all", gradient, 5)
        body.hub.r_CN_NInit = origin.tolist()
        body.hub.v_CN_NInit = np.cross(rate, origin).tolist()
    sim.InitializeSimulation()

    # Valves change at the ends of pulses, each of which is a message.
    states = []
    now = 0.0
    count = len(craft.thrusters)
    for number, command in enumerate(case.commands(), 1):
        motor = messaging.ArrayMotorTorqueMsgPayload()
        motor.motorTorque = [
            float(share * wheel.max_torque)
            for share, wheel in zip(command[count:], craft.wheels, strict=True)
        ]
        torques.write(motor, macros.sec2nano(now))
        for part, opened in craft.actuators.pulses(tuple(command[:count])):
            valves = messaging.THRArrayOnTimeCmdMsgPayload()
            valves.OnTimeRequest = [float(share) * case.period for share in opened]
            on_times.write(valves, macros.sec2nano(now))
            now += float(part) * case.period
            sim.ConfigureStopTime(macros.sec2nano(now))
            sim.ExecuteSimulation()
        found = body.scStateOutMsg.read()
        angle = case.mean_motion * number * case.period
        moved = _RADIUS * np.array([np.cos(angle), np.sin(angle), 0.0])
        moved *= bool(case.mean_motion)
        p = np.array(found.r_BN_N) - moved
        v = np.array(found.v_BN_N) - np.cross(rate, moved)
        quaternion = Rotation.from_mrp(found.sigma_BN).as_quat()
        states.append(np.hstack([p, v, found.omega_BN_B, quaternion]))
    return np.array(states)


def rows(figures: dict[str, Any] | None = None) -> Iterator[Row]:
    """A row for each case.

    Args:
        figures: Basilisk's states by case; None: it flies them now if it is installed, else those that stand here.
    """
    live = figures is None and is_installed("Basilisk")
    if figures is None and not live:
        figures = read_json(BASILISK_STATES)
    for name, case in cases().items():
        other = theirs(case) if live or figures is None else np.array(figures[name])
        own = ours(case)
        every = len(own) // len(other)  # figures are of some periods
        own = own[every - 1 :: every]
        largest = Largest()
        for quantity, columns in (("position", slice(0, 3)), ("spin", slice(6, 9))):
            largest.add(quantity, float(np.abs(own - other)[:, columns].max()))
        turned = Rotation.from_quat(own[:, 9:]).inv() * Rotation.from_quat(other[:, 9:])
        largest.add("attitude", float(turned.magnitude().max()))
        if case.mean_motion:
            del largest.values["position"]  # the Hill frame's equations are of the first order
        units = {"position": "m", "spin": "rad/s", "attitude": "rad"}
        reason = _SWINGS if case.craft.further_effectors else _RIGID
        checks = tuple(
            Check(quantity, value, case.bound, units[quantity], reason)
            for quantity, value in largest.values.items()
        )
        file = "flown by Basilisk now" if live else BASILISK_STATES.name
        yield Row(BASILISK, f"Basilisk {name}", case.about, file, checks, "1e-12 m by its step")


if __name__ == "__main__":
    write_json(
        BASILISK_STATES, {name: theirs(case)[9::10].tolist() for name, case in cases().items()}
    )
