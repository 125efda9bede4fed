"""Basilisk: spacecraft with 16 on/off thrusters each, all in one simulation, without a task or rewards."""

from __future__ import annotations

from typing import Any

import numpy as np
from Basilisk.architecture import messaging
from Basilisk.simulation import spacecraft, thrusterDynamicEffector
from Basilisk.utilities import SimulationBaseClass, macros, simIncludeThruster
from stopwatch import options, say, steps_per_second

_PERIOD = 0.2
"""s; a control period of ours, and one Runge-Kutta step of theirs."""
_EPISODE = 125
"""Control periods until a spacecraft starts again."""
_THRUSTERS = 16
_THRUST = 1.0
_MASS = 16.0
_INERTIA = 0.25
_RADIUS = 0.3
"""Of about our free-flyer's size: N, kg, kg m^2, m."""


class _Craft:
    """One of them."""

    def __init__(self, simulation: Any, number: int, random: np.random.Generator) -> None:
        self._body = spacecraft.Spacecraft()
        self._body.ModelTag = f"craft {number}"
        self._body.hub.mHub = _MASS
        self._body.hub.IHubPntBc_B = (_INERTIA * np.eye(3)).tolist()
        thrusters = thrusterDynamicEffector.ThrusterDynamicEffector()
        factory = simIncludeThruster.thrusterFactory()
        for place, direction in random.normal(size=(_THRUSTERS, 2, 3)):
            factory.create(
                "Blank_Thruster",
                (_RADIUS * place / np.linalg.norm(place)).tolist(),
                (direction / np.linalg.norm(direction)).tolist(),
                MaxThrust=_THRUST,
                areaNozzle=0.01,
                steadyIsp=100.0,
            )
        factory.addToSpacecraft(f"thrusters {number}", thrusters, self._body)
        simulation.AddModelToTask(
            "task", thrusters
        )  # first, so that the body moves under this command
        simulation.AddModelToTask("task", self._body)
        self._command = messaging.THRArrayOnTimeCmdMsgPayload(
            OnTimeRequest=np.where(random.random(_THRUSTERS) < 0.3, _PERIOD, 0.0).tolist()
        )
        self._message = messaging.THRArrayOnTimeCmdMsg().write(self._command)
        thrusters.cmdsInMsg.subscribeTo(self._message)

    def open_valves(self, now: int) -> None:
        """A command holds for one control period."""
        self._message.write(self._command, now)

    def state(self) -> Any:
        """Position, velocity, attitude, angular velocity, and more."""
        return self._body.scStateOutMsg.read()

    def start_again(self) -> None:
        """At rest at the origin."""
        hub = self._body.hub
        states = self._body.dynManager
        for name in (
            hub.nameOfHubPosition,
            hub.nameOfHubVelocity,
            hub.nameOfHubSigma,
            hub.nameOfHubOmega,
        ):
            states.getStateObject(name).setState([[0.0], [0.0], [0.0]])


def main() -> None:
    """Measure and print."""
    given = options()
    simulation = SimulationBaseClass.SimBaseClass()
    period = macros.sec2nano(_PERIOD)
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", period))
    random = np.random.default_rng(0)
    crafts = [_Craft(simulation, number, random) for number in range(given.num_envs)]
    simulation.InitializeSimulation()
    periods = 0

    def step() -> None:
        nonlocal periods
        for craft in crafts:
            craft.open_valves(periods * period)
        periods += 1
        simulation.ConfigureStopTime(periods * period)
        simulation.ExecuteSimulation()
        for number, craft in enumerate(crafts):
            craft.state()
            if (number + periods) % _EPISODE == 0:
                craft.start_again()

    say(
        "bsk",
        f"{_THRUSTERS} on/off thrusters on a free body, no task",
        f"one simulation of all, Runge-Kutta steps of {_PERIOD} s, commands and states through Python",
        given.num_envs,
        "cpu",
        steps_per_s=steps_per_second(step, given.num_envs, given.seconds),
    )


if __name__ == "__main__":
    main()
