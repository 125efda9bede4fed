"""What the safety filter keeps, and what it costs: ``python -m campaigns guard``.

Of every mission and policy, unfiltered and behind the filter: flights with a violated constraint, the share of
control periods with another command than the wanted one, what was won or reached, mean impulse, and flights
per second. Policies are the mission's shipped agent or guidance, random commands, an adversary that opens
every thruster that pushes up the steepest way out of the constraints, and agents of run folders, such as those
that `campaigns.ram` trains to enter the zones. Starts from which the filter does not
hold are counted apart (`rans_missions.guard`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from rans_missions.guard import safety_filter
from rans_missions.guard.manoeuvres import slope_of_least

from rans.effectors.commands import of_outputs
from rans.episode import Episode, Setup, World, step
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.make_controller import controller
from rans.fast.stepping.step import Backend
from rans.model.dynamics import thrust
from rans.model.fields import Field, map_leaves, where
from rans.model.random import Draws, seed_words
from rans.model.spacecraft_file import load_spacecraft
from rans.policy.network import Network
from rans.pretrained import pretrained_names
from rans.randomization.conditions import (
    Conditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.registry import trust_files
from rans.tasks import load_task

MISSIONS = {
    "avoid-2d": ("avoid", "floating-platform"),
    "avoid-3d": ("avoid", "free-flyer"),
    "dock-port-2d": ("dock-port", "floating-platform"),
    "dock-port-2d-atmos": ("dock-port", "atmos"),
    "dock-port-3d": ("dock-port", "free-flyer"),
    "dock": ("dock", "afrl-deputy"),
    "hold": ("hold", "vbar-chaser"),
    "rendezvous": ("rendezvous", "arpod-chaser"),
    "inspect": ("inspect", "afrl-deputy"),
}
"""Task and spacecraft of each."""
SEED = 2031
"""Starts that nobody was trained, chosen or judged on."""
Policy = Callable[[Any, Any, tuple[Field, ...]], tuple[Field, ...]]
"""Commands for states, goals and observations."""


def adversary(world: World) -> Policy:
    """Opens every thruster that pushes down the slope of the least margin, fully."""
    forces = np.array(world.craft.wrench_map)[:, : world.craft.dimension]

    def act(state: Any, goal: Any, seen: tuple[Field, ...]) -> tuple[Field, ...]:
        slope = slope_of_least(world, state, goal)
        way = state.attitude.inverse().rotate(slope.scale(-1.0))
        # Of constraints on the speed there is no slope over positions: towards the goal, as fast as it goes.
        towards = state.attitude.inverse().rotate(goal.p - state.p)
        flat = slope.norm() < 1e-4
        if all("speed" in name for name in world.task.constraints(state, goal)):
            flat = slope.norm() < 1e30
        way = type(way)(
            *(where(flat, b, a) for a, b in zip(way.columns(), towards.columns(), strict=True))
        )
        opened = []
        for force in forces:
            push = sum(x * float(f) for x, f in zip(way.columns(), force, strict=True))
            opened.append(where(push > 0.3 * way.norm(), push * 0.0 + 1.0, push * 0.0))
        return tuple(opened)

    return act


def random_commands(world: World, backend: Backend) -> Policy:
    """Each thruster open or shut with equal chances; throttles and pulsed valves at any level."""
    steady = world.craft.is_continuous
    if backend.on_numpy:
        rng = np.random.default_rng(0)

        def of_numpy(state: Any, goal: Any, seen: tuple[Field, ...]) -> tuple[Field, ...]:
            size = len(state.p.columns()[0])
            drawn = rng.random((len(world.craft.commands), size), dtype=np.float32)
            return tuple(drawn if steady else np.round(drawn))

        return of_numpy
    generator = torch.Generator(backend.device).manual_seed(0)

    def of_torch(state: Any, goal: Any, seen: tuple[Field, ...]) -> tuple[Field, ...]:
        size = len(state.p.columns()[0])
        shape = len(world.craft.commands), size
        drawn = torch.rand(shape, generator=generator, device=backend.device)
        return (drawn if steady else drawn.round()).unbind()

    return of_torch


def shipped(name: str, world: World, backend: Backend, size: int) -> Policy:
    """The agent that comes with RANS; guidance where there is none."""
    if name not in pretrained_names():
        return guided(world, backend, size)
    return trained(f"pretrained:{name}", world, backend, size)


def trained(name: str, world: World, backend: Backend, size: int) -> Policy:
    """An agent without a memory, by its name or run folder."""
    trust_files()
    network: Any = contestant(name).controller
    network = Network(
        network.network.architecture,
        {key: x.to(backend.device, torch.float32) for key, x in network.network.tensors.items()},
    )

    def act(state: Any, goal: Any, seen: tuple[Field, ...]) -> tuple[Field, ...]:
        rows = [x + 0.0 * state.p.columns()[0] for x in seen]
        observed = backend.stack(rows).to(torch.float32).T
        command, _ = network.deterministic_action(observed, network.initial_state(size))
        columns = command.T.contiguous()
        outputs = tuple(columns.numpy() if backend.on_numpy else columns)
        return tuple(of_outputs(world.craft, outputs))

    return act


def guided(world: World, backend: Backend, size: int) -> Policy:
    """Velocity-to-gain guidance, on the CPU."""
    pilot = controller("guidance", world.setup)
    pilot.reset(size)

    def whole(x: Any) -> Any:
        one = torch.as_tensor(x).cpu().numpy().astype(np.float64)
        return np.broadcast_to(one, size)

    def act(state: Any, goal: Any, seen: tuple[Field, ...]) -> tuple[Field, ...]:
        observed = np.zeros((size, 1), np.float32)
        commands = pilot.act(map_leaves(whole, state), map_leaves(whole, goal), observed)
        return tuple(backend.put(x, torch.float32) for x in commands.T)

    return act


def setup_of(mission: str, conditions: Conditions | None = None) -> Setup:
    """Spacecraft, task with evaluation starts, and timing of one of `MISSIONS`."""
    task_name, craft_name = MISSIONS[mission]
    task = load_task(task_name).for_evaluation()
    return Setup(load_spacecraft(craft_name), task, task.timing, conditions)


def noise_and_delay(mission: str, noise: tuple[float, float], delay: float) -> Conditions | None:
    """Conditions of standard deviations, m and m/s, and a delay in control periods; None: neither."""
    if not (any(noise) or delay):
        return None
    position, velocity = (SensorConditions(noise=sigma) for sigma in noise)
    period = load_task(MISSIONS[mission][0]).timing.control_period
    return Conditions(
        thrusters=ThrusterConditions(command_delay=delay * period),
        sensors=SensorsConditions(position=position, velocity=velocity),
    )


class Begun(NamedTuple):
    """Flights of N starts at their first instant, in single precision."""

    backend: Backend
    world: World
    draws: Draws
    episode: Episode
    safe: Any
    """(N,) whether the filter holds from the start."""


def begun(setup: Setup, filtered: bool, numbers: np.ndarray, device: str, plain: bool) -> Begun:
    """Flights of the starts of these numbers, (N,), without the filter or behind it."""
    guard: Any = safety_filter(setup)
    backend = Backend.of(device, torch.float32, None, plain)
    world = World(setup._replace(guard=guard if filtered else None), backend.nodes)
    first = backend.put(numbers.astype(np.int32), torch.int32)
    draws = Draws(*seed_words(SEED), first, 0, backend.fields)
    clock = draws.first * 0
    episode = world.begin(*world.scenario(clock, draws), clock, draws)
    never = episode.state.p.columns()[0] * 0.0 > 1.0
    return Begun(
        backend, world, draws, episode, guard.safe(world, episode.state, episode.goal) | never
    )


@torch.no_grad()
def flown(
    mission: str,
    policy: str,
    filtered: bool,
    count: int,
    device: str,
    plain: bool = False,
    conditions: Conditions | None = None,
) -> dict[str, Any]:
    """Fly them all, in single precision."""
    setup = setup_of(mission, conditions)
    craft, task = setup.craft, setup.task
    backend, world, draws, now, holds = begun(setup, filtered, np.arange(count), device, plain)
    zero = now.state.p.columns()[0] * 0.0
    if policy == "random":
        act = random_commands(world, backend)
    elif policy == "adversary":
        act = adversary(world)
    elif policy == "shipped":
        act = shipped(mission, world, backend, count)
    else:
        act = trained(policy, world, backend, count)

    never = zero > 1.0
    ended = never
    violated = never
    won = never
    least = zero + 1e30
    changed = flying = impulse = zero
    settled = zero
    steps = task.timing.episode_steps
    k = 0
    ends = task.done(now.state, now.goal) is not None
    clock = time.perf_counter()
    for k in range(steps):
        outcome = step(world, now, act(now.state, now.goal, world.observe(now, draws)), draws)
        now = outcome.episode
        going = ~ended
        for margin in outcome.margins.values():
            violated = violated | (going & (margin < 0.0))
            least = where(going & (margin < least), margin, least)
        given = thrust(craft, outcome.command)
        spent = sum((x * f for x, f in zip(given, world.forces, strict=True)), zero)
        impulse = impulse + where(going, spent * task.timing.control_period, zero)
        flying = flying + where(going, zero + 1.0, zero)
        if outcome.guarded is not None:
            changed = changed + where(going & outcome.guarded, zero + 1.0, zero)
        if outcome.done is not None:
            won = won | (going & outcome.done & ~outcome.failed)
        else:
            # Time since which it has been within every tolerance.
            settled = where(outcome.reached, settled, zero + (k + 1.0))
        ended = ended | outcome.terminated
        if bool(ended.all()):
            break
    seconds = time.perf_counter() - clock
    if not ends:
        won = ~ended & (settled <= 0.8 * steps)
        after = settled
    else:
        after = flying
    total = float(flying.sum())
    inside = holds
    return {
        "mission": mission,
        "who": f"{policy}{', filtered' if filtered else ''}",
        "flights": count,
        # Starts from which the filter does not hold, and flights in which a margin was negative, from the others
        # and from those.
        "unsafe": int((~inside).sum()),
        "violated": int((violated & inside).sum()),
        "violated_unsafe": int((violated & ~inside).sum()),
        "least": float(least[inside].min()),
        # Share of the control periods flown with another command than the wanted one.
        "interventions": float(changed.sum()) / total,
        # Share of flights that were won; of missions without an end, within all tolerances in the last fifth.
        "reached": float(won.sum()) / count,
        # Median time until that, s.
        "settled": float(np.median(torch.as_tensor(after)[torch.as_tensor(won)].cpu().numpy()))
        * task.timing.control_period
        if bool(won.any())
        else float("nan"),
        "impulse": float(impulse.sum()) / count,
        "rate": (k + 1) * count / seconds,
    }


@dataclass(frozen=True)
class Guarded:
    """Fly missions behind the safety filter, and without it."""

    missions: tuple[str, ...] = ("avoid-2d", "avoid-3d", "dock-port-2d", "dock")
    """Of `MISSIONS`."""
    policies: tuple[str, ...] = ("shipped", "random", "adversary")
    """Who flies: shipped, random, adversary, or a run folder."""
    flights: int = 1024
    """Of each policy behind the filter."""
    unfiltered: int | None = None
    """Flights without the filter; as many by default, 0 for none."""
    device: str = "cpu"
    """Torch device."""
    noise: tuple[float, float] = (0.0, 0.0)
    """Standard deviations of measured positions, m, and velocities, m/s."""
    delay: float = 0.0
    """Time from a decision until the command arrives, in control periods."""
    plain: bool = False
    """Step torch's tensors on a CPU too."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Flights of every mission and policy."""
        for mission in self.missions:
            for policy in self.policies:
                for filtered in (True, False):
                    wanted = (
                        self.flights if filtered or self.unfiltered is None else self.unfiltered
                    )
                    if wanted:
                        yield flown(
                            mission,
                            policy,
                            filtered,
                            wanted,
                            self.device,
                            self.plain,
                            noise_and_delay(mission, self.noise, self.delay),
                        )
