"""Flights that go on after a success and after a deadline, as those of a simulator or a robot that nothing ends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rans.episode.flight import Controller
from rans.episode.scenario import Scenario
from rans.episode.step import Episode, Setup, World, step
from rans.model.fields import map_leaves


@dataclass(frozen=True)
class Continued:
    """What N craft did in T control periods, whatever their tasks said of it."""

    period: float
    """s"""
    change: np.ndarray
    """(T, N) change of velocity that the thrusters could give: impulse over mass, m/s."""
    reached: np.ndarray
    """(T, N) bool: within all tolerances at the end of the period."""
    margin: np.ndarray
    """(T, N) least margin of the constraints at the end of the period; infinite without any."""
    won: np.ndarray
    """(N,) bool: succeeded at some time."""
    commands: np.ndarray
    """(T, N, commands)"""
    end: Episode

    def after(self, time: float) -> Continued:
        """What followed a time, s."""
        first = round(time / self.period)
        parts = (self.change, self.reached, self.margin, self.commands)
        change, reached, margin, commands = (part[first:] for part in parts)
        return replace(self, change=change, reached=reached, margin=margin, commands=commands)

    def spent(self, seconds: float) -> np.ndarray:
        """(N,) largest change of velocity in any time of so many s, m/s."""
        width = round(seconds / self.period)
        total = np.concatenate([np.zeros((1, self.change.shape[1])), self.change.cumsum(axis=0)])
        return (total[width:] - total[:-width]).max(axis=0)


def flown_on(setup: Setup, controller: Controller, starts: Scenario, seconds: float) -> Continued:
    """Ask a controller in every control period for a time, s, from a batch of starts; nothing ends a flight."""
    craft, task, timing = setup.craft, setup.task, setup.timing
    world = World(setup)
    episode = world.begin(starts.start, starts.goal, 0)
    count = np.size(starts.start.p.x)
    if craft.stores:
        state = map_leaves(lambda x: np.broadcast_to(x, count), episode.state)
        episode = replace(episode, state=state)
    controller.reset(count)
    forces = np.array([thruster.force for thruster in craft.thrusters])
    change, reached, margins, commands = [], [], [], []
    won = np.zeros(count, bool)
    for _ in range(round(seconds / timing.control_period)):
        seen = np.zeros((count, 0), np.float32)
        if getattr(controller, "observes", True):
            seen = np.stack(world.observe(episode, None), axis=1).astype(np.float32)
        command = np.asarray(controller.act(episode.state, episode.goal, seen), float)
        outcome = step(world, episode, tuple(command.T), rewarded=False)
        episode = outcome.episode
        if outcome.done is not None:
            won |= outcome.done
        impulse = command[:, : len(forces)] @ forces * timing.control_period
        change.append(impulse / craft.mass)
        reached.append(np.broadcast_to(task.reached(episode.state, episode.goal), count))
        least = [np.full(count, np.inf)]
        least += task.constraints(episode.state, episode.goal).values()
        margins.append(np.min(np.broadcast_arrays(*least), axis=0))
        commands.append(command)
    return Continued(
        timing.control_period,
        np.array(change),
        np.array(reached),
        np.array(margins),
        won,
        np.array(commands),
        episode,
    )
