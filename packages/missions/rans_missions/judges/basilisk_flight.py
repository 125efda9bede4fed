"""Fly the cases of basilisk.py in Basilisk (`bsk` of the package index) and print their states as JSON."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rans_missions.judges.basilisk import Case, cases

_STEP = 0.002
_RADIUS = 7e9


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
    fuel = craft.propellant
    if fuel is not None:
        from Basilisk.simulation import fuelTank

        at = np.array(fuel.position) - centre
        mass -= fuel.mass
        offset = -fuel.mass / mass * at
        inertia = inertia - 0.4 * fuel.mass * fuel.radius**2 * np.eye(3)
        for part, arm in ((fuel.mass, at), (mass, offset)):
            inertia -= part * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        tank = fuelTank.FuelTank()
        model = fuelTank.FuelTankModelConstantVolume()
        model.propMassInit = fuel.mass
        model.r_TcT_TInit = column([0.0, 0.0, 0.0])
        model.radiusTankInit = fuel.radius
        tank.setTankModel(model)
        tank.setR_TB_B(column(at))
        body.addStateEffector(tank)
        sim.AddModelToTask("all", tank, 4)
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
        nozzle.steadyIsp = 300.0 if fuel is None else fuel.specific_impulse
        nozzle.updateOnly = True
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
            if fuel is not None:
                forces = np.array([t.force for t in craft.thrusters])
                tank.setFuelLeakRate(float(np.array(opened, float) @ forces) / fuel.exhaust_speed)
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


print(json.dumps({name: theirs(case)[9::10].tolist() for name, case in cases().items()}))
