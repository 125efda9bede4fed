"""Fitted value iteration with the exact model, and a policy network that imitates its commands.

The value V(s) of a state is the least cost of a flight from it: time outside the goal set, and a price for impulse,
for every trade-off between both. A command is the pattern of open valves with the least cost of its period and of
the value after it. V is a network, fitted to the costs of such flights over some periods and its own value at their
end (D. Bertsekas, "Dynamic programming and optimal control", volume 2, chapter 6). Its commands then are the labels
of a policy network in the states which that reaches (S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation
learning and structured prediction to no-regret online learning", AISTATS 2011).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from rans import Engine, PPOSettings
from rans.extend import (
    Acted,
    Adam,
    Algorithm,
    ConfigError,
    Network,
    Rollout,
    Spacecraft,
    TrainConfig,
    craft_of,
    fused,
    remember,
    whole,
)
from rans.fast.learn.graph import graphed
from rans_value.controller import POSES, SHIPPED, GreedyController, check_craft, suits
from rans_value.goal_frame import equivalent
from rans_value.greedy import Greedy
from rans_value.network import ValueNetwork
from rans_value.problem import TRADE_OFF, PoseProblem

_PERIODS = 10
"""Control periods that are flown to a target."""
_FLIGHTS = 6
"""Rounds of flights that are fitted together."""
_BEGUN = 400
"""Gradient steps on the value function to begin with."""
_GOES_ON = 0.6
"""Part of the flights of a round that begin where others ended."""
_LOST = 6.0
"""Value, in times in which the craft gains its range and that at full thrust, beyond which flights do not go on."""
_KEEP = 0.98
"""Average of the weights of the value function over gradient steps, by which is flown."""
_STAGES = ((0.75, 1.0), (50 / 380, 60 / 380))
"""Parts of the training at which the value function is fitted, and its commands are imitated. In space what
imitation leaves is then learnt from flights of the policy, by iterations of a quarter of a second."""
_RATE = 1e-3
"""First step size of the value function, which falls to a hundredth."""
_BY_POLICY = 0.8
"""Part of the flights to be imitated that the policy flies, so that it learns from what it reaches."""
_LABELLED = 8
"""Iterations whose labels are imitated together."""
_DECIDED = 0.02
"""Cost of a pattern above that of the best, at which its label counts a third, s."""
_GAIN = 8.0
"""Log-odds of a valve for a command between 0 and 1 of craft that have those, and the sharpness of a wheel's."""
_RATES = (1.0, 0.02, 0.4, 0.008)
"""Step sizes, of the first, with which imitation and learning from flights begin and end."""
_ROLLOUTS = 2
"""Rollouts of the policy in an iteration in which it learns from its own flights."""
_STEPS = 48
"""Gradient steps of the policy on the flights of an iteration: three passes over them."""
_TRACE = 0.9
"""Weight of what the next period costs more than the values expected, over that of the present one."""
_LEFT = 2.0
"""Cost of leaving the tolerances, seconds outside."""

_COLLECTED = ("ends", "flights", "labels", "labelled")
"""What a training on a CPU goes on with, bit by bit."""


@dataclass(frozen=True)
class ValueSettings:
    """Hyper-parameters of fitted value iteration, besides `PPOSettings`, which are those of the policy network.

    Raises:
        ConfigError: a number is out of its range.
    """

    units: int = 512
    """Units of each of the four hidden layers; with others than those that ship the fit begins from nothing."""
    states: int = 24576
    """States from which a round of flights begins."""
    rounds: int = 4
    """Rounds of flights in an iteration."""
    updates: int = 32
    """Gradient steps of the value function in a round, and a thirtieth of those of the policy in an iteration."""
    batch: int = 65536
    """States in a gradient step of the value function."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            whole(name, value)


class ValueLearner:
    """Learner by fitted value iteration; a `rans.fast.learn.learner.Learner`.

    Args:
        engine: engine of a craft with thrusters and, in the plane, wheels that flies to a pose.
        network: policy network, changed in place.
        settings: ``batch_size`` and ``learning_rate`` are those of the imitation.
        generator: random generator whose seed is used.
        plain: without meaning: the network is computed by single operations of torch.
        own: further hyper-parameters of this learner.

    Raises:
        ConfigError: craft, task, network or processes are of another kind.
    """

    statistics = ("value_loss", "value", "grad_norm")
    description = "fitted value iteration"

    def __init__(
        self,
        engine: Engine,
        network: Network,
        settings: PPOSettings,
        generator: torch.Generator,
        plain: bool,
        own: ValueSettings,
    ) -> None:
        _check(engine, network)
        self.engine = engine
        self.network = network
        self.settings = settings
        self.n_steps = settings.n_steps
        self.rollout = Rollout(engine, network, settings.n_steps)
        self.adam = Adam(network, settings.learning_rate)
        self._own = own
        self._progress = 0.0
        device = engine.device
        self._generator = torch.Generator(device).manual_seed(generator.initial_seed())
        self.problem = PoseProblem(engine.craft, engine.task, engine.timing)
        # The value function, and its average, by which is flown.
        self._pool = self.states()
        example = torch.cat((self._pool, self._fresh()), dim=1)
        torch.manual_seed(generator.initial_seed())
        self.value = ValueNetwork(self.problem, example, own.units)
        self.average = deepcopy(self.value)
        self.greedy = Greedy(self.problem, self.average)
        self._value_adam = torch.optim.Adam(
            self.value.parameters(),
            torch.tensor(_RATE, device=device),
            fused=True,
            capturable=device.type == "cuda",
        )
        self._loss = fused(self._loss_of, device)
        sides = (self.problem.turn, self.problem.hand, self.problem.place)
        self._turn, self._hand, self._place = (x.to(device) for x in sides)
        # Flights of the last rounds, and labels of the last periods, of which a new one replaces the oldest.
        self._ends = example
        self._flights: list[tuple[Tensor, Tensor]] = []
        self._labels: list[Tensor] = []
        self._labelled = 0
        # Batches of states and of labels, at addresses that stay, and the gradient steps on them.
        self._sample: list[Tensor] = []
        self._batch: list[Tensor] = []
        self._fitting = graphed(self._fitted, device)
        self._descent = graphed(self._descend, device)
        self._improvement = graphed(self._improve, device)
        self._stages = _STAGES[_learns_from_flights(engine.craft)]

    def slow_down(self, remaining: float) -> None:
        """Reduce the step sizes of value function and policy while ``remaining`` falls from 1 to 0."""
        self._progress = 1.0 - remaining
        fitted, imitated = self._stages
        done = min(1.0, self._progress / fitted)
        for group in self._value_adam.param_groups:
            group["lr"].fill_(_RATE * (0.01 + 0.495 * (1 + math.cos(math.pi * done))))
        rate = np.interp(self._progress, (fitted, imitated, imitated, 1.0), _RATES)
        self.adam.rate.fill_(self.settings.learning_rate * rate)

    def learn(self) -> Tensor:
        """Run one iteration, see `rans.fast.learn.learner.Learner.learn`."""
        loss = norm = torch.zeros((), device=self.engine.device)
        self.rollout.begin()
        fitted, imitated = self._stages
        if self._progress < fitted:
            self.engine.reset()
            self.engine.stagger()
            self._pool = self.states()
            if not self._flights:
                self._begin()
            losses = [self._round() for _ in range(self._own.rounds)]
            loss = torch.stack(losses).mean()
        elif self._progress < imitated:
            self._fly()
            labels = [x[: self._labelled].flatten(0, 1) for x in self._labels]
            count = 30 * self._own.updates
            norm = self._steps(self._descent, labels, self.settings.batch_size, count)
        else:
            if self._labels:
                self._labels, self._batch = [], []
            flights = self._flown_by_policy()
            norm = self._steps(self._improvement, flights, self._own.batch, _STEPS)
        result = torch.stack((loss, self._flights[-1][1].mean(), norm))
        return torch.cat((result, self.adam.rate[None], self.rollout.totals()))

    def states(self) -> Tensor:
        """States (rows, N) of the engine's episodes in the frame of their goals."""
        engine = self.engine
        return self.problem.frame.relative(engine.state, engine.goal, self.rollout.terms, TRADE_OFF)

    # The value function: flights by its commands, and gradient steps towards their costs.

    def _uniform(self, *shape: int) -> Tensor:
        return torch.rand(shape, generator=self._generator, device=self.engine.device)

    def _indices(self, below: int, count: int) -> Tensor:
        return torch.randint(below, (count,), generator=self._generator, device=self.engine.device)

    def _fresh(self) -> Tensor:
        """States (rows, N) at which flights begin: half those of the task's episodes, half near the goal."""
        count = self._own.states
        chosen = self._pool[:, self._indices(self._pool.shape[1], count)]
        # Trade-offs of all tasks, a twelfth of them at either end, and more of long thrifty flights.
        chosen[-1] = (1.2 * self._uniform(count) - 0.1).clamp(min=0.0, max=1.0) ** 0.75
        near = self.problem.near(self._uniform(self.problem.numbers, count), chosen)
        return torch.where(self._uniform(count) < 0.5, near, chosen)

    def _begin(self) -> None:
        """Fit the first value function: a guess, or that of a craft alike where it is less."""
        first = None
        if (other := self._alike()) is not None:
            for network in (self.value, self.average):
                network.begin_as(other)
            first = deepcopy(self.average)
        for _ in range(_BEGUN):
            pool = self._fresh()[:, self._indices(self._own.states, self._own.batch)]
            target = self.problem.guess(pool)
            if first is not None:
                with torch.no_grad():
                    target = torch.minimum(target, first(pool))
            self._fit(pool, target)

    def _alike(self) -> ValueNetwork | None:
        """Value function of the craft most alike of those that ship, or None where the layers differ."""
        files = sorted(SHIPPED.glob("*/config.json"))
        networks: Any = (GreedyController(file.parent).greedy.value for file in files)
        return min(
            filter(self.value.resembles, networks),
            key=lambda x: (-x.problem.limits, abs(math.log(x.problem.scale / self.problem.scale))),
            default=None,
        )

    @torch.no_grad()
    def _flown(self) -> tuple[Tensor, Tensor]:
        """States (rows, T N) of a round of flights and the costs from there, (T N,)."""
        fresh = self._fresh()
        count = fresh.shape[1]
        ends = self._ends[:, self._indices(self._ends.shape[1], count)]
        # A state in which another trade-off may be asked for.
        ends[-1] = torch.where(self._uniform(count) < 0.2, fresh[-1], ends[-1])
        state = torch.where(self._uniform(count) < _GOES_ON, ends, fresh)
        # The cost of a command at random is no value, but where it leads to is a state like others.
        other = (self._uniform(count, self.engine.craft.command_count) < 0.25).to(state.dtype)
        disturbed = self.greedy.outcomes(state, other[None])[3:, 0]
        state = torch.where(self._uniform(count) < 0.25, disturbed, state)
        periods = []
        for _ in range(_PERIODS):
            outcome = self.greedy.best(state, 1)[1]
            periods.append((state, *outcome[1:3]))
            state = outcome[3:]
        # Errors of the fit are averaged over all sides: the least of costs with errors is too low.
        turn, hand = (x.repeat_interleave(count, dim=0) for x in (self._turn, self._hand))
        seen = equivalent(state.repeat(1, len(self._turn)), turn, hand)
        target = self.average(seen).view(-1, count).mean(dim=0)
        # Flights that are over, or never come to rest, begin anew.
        most = _LOST * self.problem.scale * (1.0 + self.problem.price(state))
        goes_on = (target < most) & ~self.problem.frame.is_over(state)
        self._ends = torch.where(goes_on, state, fresh)
        states, targets = [], []
        for before, cost, discount in reversed(periods):
            target = cost + discount * target
            states.append(before)
            targets.append(target)
        return torch.cat(states, dim=1), torch.cat(targets)

    def _round(self) -> Tensor:
        """A round of flights, and gradient steps on those of the last rounds; returns the mean loss."""
        self._flights = [*self._flights[1 - _FLIGHTS :], self._flown()]
        states, targets = (torch.cat(x, dim=-1) for x in zip(*self._flights, strict=True))
        losses = []
        for _ in range(self._own.updates):
            chosen = self._indices(len(targets), self._own.batch)
            losses.append(self._fit(states[:, chosen], targets[chosen]))
        return torch.stack(losses).mean()

    def _fit(self, state: Tensor, target: Tensor) -> Tensor:
        """One gradient step on states (rows, N) as seen from equivalent sides; returns the loss."""
        side = self._indices(len(self._turn), state.shape[1])
        _put(self._sample, (state, target, self._turn[side], self._hand[side]))
        return self._fitting().clone()

    def _fitted(self) -> Tensor:
        loss = self._loss(*self._sample)
        weights = [*self.value.parameters()]
        for weight, gradient in zip(weights, torch.autograd.grad(loss, weights), strict=True):
            weight.grad = gradient
        nn.utils.clip_grad_norm_(weights, 1.0)
        self._value_adam.step()
        with torch.no_grad():
            torch._foreach_lerp_(  # type: ignore[attr-defined]  # private in torch
                [*self.average.parameters()], weights, 1.0 - _KEEP
            )
        return loss.detach()

    def _loss_of(self, state: Tensor, target: Tensor, turn: Tensor, hand: Tensor) -> Tensor:
        seen = equivalent(state, turn, hand)
        # Errors count relative to the value, with a floor of a tenth of the time scale.
        floor = 0.1 * self.problem.scale * (1.0 + self.problem.price(state))
        error = (self.value(seen) - target) / (target + floor)
        # Nothing follows the end of a flight, and nobody asks for the value there.
        error = error.where(~self.problem.frame.is_over(seen), 0.0)
        return functional.smooth_l1_loss(error, torch.zeros_like(error), beta=0.05)

    # The policy: commands of the value function in states that the policy reaches.

    @torch.no_grad()
    def _fly(self) -> None:
        """Fly ``n_steps`` periods and label them."""
        engine = self.engine
        network = self.network
        rollout = self.rollout
        count = engine.num_envs
        own = torch.arange(count, device=engine.device)[:, None] < _BY_POLICY * count
        observation = engine.observe()
        for slot in rollout.steps:
            state = self.states()
            # Labels are of the side from which the craft is looked at: there, equal states have equal ones.
            columns, _, order = network.look(network.in_body(observation))
            order = self._place[:1].expand(count, -1) if order is None else order
            side = (order[:, None] == self._place).all(dim=2).to(torch.uint8).argmax(dim=1)
            seen = equivalent(state, self._turn[side], self._hand[side])
            patterns, regret = self.greedy.label(seen)
            # The network may look from sides from which the task is another one: there, in its order of thrusters.
            opened = patterns.gather(2, self._place[side].expand_as(patterns))
            patterns = torch.zeros_like(patterns).scatter(2, order.expand_as(patterns), opened)
            least = regret.argmin(dim=0)[None, :, None].expand(1, -1, patterns.shape[2])
            label = patterns.gather(0, least)[0]
            mode = network.evaluate_seen(columns).policy.mode()
            command = torch.where(own, engine.commands(mode), label).gather(1, order)
            acted = Acted(command, slot.log_prob, slot.value, command, None)
            unit = _DECIDED * (1.0 + self.problem.price(state))
            # Of valves in the memory of truth values.
            kind = patterns.dtype if engine.craft.wheels else torch.bool
            labels = columns, patterns.transpose(0, 1).to(kind), (regret / unit).T
            if not self._labels:
                self._labels = [x.new_empty(_LABELLED * self.n_steps, *x.shape) for x in labels]
            for kept, x in zip(self._labels, labels, strict=True):
                kept[self._labelled % len(kept)] = x
            self._labelled += 1
            network.update_statistics(columns[None])
            step = engine.step(command)
            remember(observation, acted, None, step, slot, rollout)
            observation = step.observation

    def _steps(self, step: Any, rows: list[Tensor], size: int, count: int) -> Tensor:
        """Gradient steps of the policy on batches of rows; returns the mean norm."""
        norms = []
        # The value function needs more bits of its inputs than gradients do.
        precision = torch.get_float32_matmul_precision()
        torch.set_float32_matmul_precision("high")
        try:
            for _ in range(count):
                chosen = self._indices(len(rows[0]), size)
                _put(self._batch, [x[chosen] for x in rows])
                norms.append(step().clone())
        finally:
            torch.set_float32_matmul_precision(precision)
        return torch.stack(norms).mean()

    def _descend(self) -> Tensor:
        """One gradient step of the policy on the batch; returns the norm."""
        columns, patterns, regrets = self._batch
        policy: Any = self.network.evaluate_seen(columns).policy
        logit = policy.logit if hasattr(policy, "logit") else _GAIN * (policy.mean - 0.5)
        # The probability that the policy opens one of the patterns, those that cost more counting less: of two that
        # are as good it may have either, and never what lies between them.
        count = self.engine.craft.thruster_count
        side = 1.0 - 2.0 * patterns[..., :count]
        likely = -functional.softplus(side * logit[:, None, :count]).sum(dim=2)
        if self.engine.craft.wheels:
            off = policy.mean[:, None, count:] - (0.5 + 0.5 * patterns[..., count:])
            likely = likely - (_GAIN * off).square().sum(dim=2)
        loss = -torch.logsumexp(likely - regrets, dim=1).mean()
        return self.adam.descend(loss, math.inf, self.engine.processes)

    @torch.no_grad()
    def _flown_by_policy(self) -> list[Tensor]:
        """Fly by random commands of the policy.

        Returns columns that the network saw, (T N, columns), commands in its order of thrusters, (T N, n), their
        log-probabilities, and how much less than the value function expects they cost, of unit deviation, (T N,).
        """
        engine = self.engine
        network = self.network
        problem = self.problem
        observation = engine.observe()
        periods = []
        for _ in range(_ROLLOUTS):
            self.rollout.begin()
            for slot in self.rollout.steps:
                state = self.states()
                columns, _, order = network.look(network.in_body(observation))
                policy: Any = network.evaluate_seen(columns).policy
                action = policy.sample(self._uniform(*policy.logit.shape))
                command = action if order is None else action.gather(1, order)
                outcome = self.greedy.outcomes(state, command[None])[:, 0]
                was, held = (problem.inside(x)[0] for x in (state, outcome[3:]))
                above = (outcome[0] - self.average(state)) / (1.0 + problem.price(state))
                above += _LEFT * (was & ~held)
                step = engine.step(engine.commands(command))
                acted = Acted(command, slot.log_prob, slot.value, command, None)
                remember(observation, acted, None, step, slot, self.rollout)
                observation = step.observation
                goes_on = outcome[2] * ~(step.terminated | step.truncated)
                periods.append((columns, action, policy.log_prob(action), above, goes_on))
        *seen, above, goes_on = (torch.stack(x) for x in zip(*periods, strict=True))
        # What the next periods cost counts, too (generalised advantages).
        for t in reversed(range(len(above) - 1)):
            above[t] += _TRACE * goes_on[t] * above[t + 1]
        return [x.flatten(0, 1) for x in (*seen, (above.mean() - above) / above.std())]

    def _improve(self) -> Tensor:
        """One gradient step of the policy on flights; returns the norm.

        The clipped objective of J. Schulman et al., "Proximal policy optimization algorithms", 2017, of which the
        value function is the critic.
        """
        columns, action, before, gain = self._batch
        ratio = (self.network.evaluate_seen(columns).policy.log_prob(action) - before).exp()
        loss = -torch.minimum(gain * ratio, gain * ratio.clamp(0.8, 1.2)).mean()
        return self.adam.descend(loss, math.inf, self.engine.processes)

    def state(self) -> dict[str, Any]:
        """State of the learner; on a GPU without flights and labels, which a resumed training collects again."""
        state = {
            "weights": {name: x.detach() for name, x in self.network.tensors.items()},
            "adam": self.adam.state(),
            "average": self.average.state_dict(),
            "value": self.value.state_dict(),
            "moments": [[*moments.values()] for moments in self._value_adam.state.values()],
            "generator": self._generator.get_state(),
            "clocks": torch.get_rng_state(),
        }
        if self.engine.device.type == "cpu":  # of a GPU they have hundreds of megabytes
            state |= {name: getattr(self, f"_{name}") for name in _COLLECTED}
        return state

    @torch.no_grad()
    def load(self, saved: dict[str, Any]) -> None:
        """Continue from the result of `state`."""
        for name, tensor in self.network.tensors.items():
            tensor.copy_(saved["weights"][name])
        self.adam.load(saved["adam"])
        self.average.load_state_dict(saved["average"])
        self.value.load_state_dict(saved.get("value", saved["average"]))
        for weight, moments in zip(self.value.parameters(), saved.get("moments", ()), strict=False):
            names = ("step", "exp_avg", "exp_avg_sq")
            self._value_adam.state[weight] = dict(zip(names, moments, strict=True))
        self._generator.set_state(saved["generator"].cpu())
        if "flights" in saved and self.engine.device.type == "cpu":
            for name in _COLLECTED:
                setattr(self, f"_{name}", saved[name])
        else:
            self._flights = [self._flown()]
        if "clocks" in saved:
            torch.set_rng_state(saved["clocks"].cpu())


def _put(kept: list[Tensor], tensors: Sequence[Tensor]) -> None:
    """Copy tensors to where the first of them were put."""
    if not kept:
        kept += [x.clone() for x in tensors]
    for old, new in zip(kept, tensors, strict=True):
        old.copy_(new)


def _check(engine: Engine, network: Network) -> None:
    """Reject (`ConfigError`) engines and networks for which there is no such value function."""
    craft = engine.craft
    check_craft(craft)
    policy = network.architecture
    if engine.processes.size > 1 or policy.memory or policy.backbone != "dense":
        raise ConfigError(
            "the algorithm 'value' trains one dense network without a memory in one process: leave out torchrun, "
            "ppo.memory, ppo.filters and ppo.backbone."
        )


def _learns_from_flights(craft: Spacecraft) -> bool:
    """Whether policies imitate values too poorly: in space. The spread of throttles is not learnt."""
    return craft.dimension == 3 and not craft.is_continuous


_ITERATIONS = ((96, 272), (380, 1140))
"""Iterations of a training that begins with values that ship, and from nothing; then those whose policy learns from
its flights too. What more of them gain: docs/decisions/value.md."""
_POLICY: dict[str, Any] = {
    "n_steps": 8,
    "batch_size": 16384,
    "learning_rate": 1e-3,
    "layers": (448, 448, 448),
    "matmul": "float32",
    "zoom": 16.0,
}
"""Hyper-parameters of the policy."""
_SMALL: dict[str, Any] = {"units": 96, "states": 512, "rounds": 2, "updates": 16, "batch": 2048}
_SMALL_POLICY: dict[str, Any] = {"n_envs": 256, "batch_size": 1024, "layers": (128, 128)}
"""Sizes of fit and policy on a CPU, in place of those of a GPU."""
_ENVS = (12288, 65536)
"""Flights in the plane, and in space, where the policy learns from its own."""
_FINE = 0.5 * math.radians(5.0)
"""Largest turn by a pulse that the next period stops, rad: half the tolerance. At 0.7 of it 5 to 10 % of flights
leave the pose (docs/decisions/value.md)."""


class Value(Algorithm):
    """Fitted value iteration with the exact model."""

    settings: ClassVar[type] = ValueSettings
    plain_network: ClassVar[bool] = True

    @classmethod
    def best(cls, config: TrainConfig, craft: Spacecraft) -> TrainConfig | None:
        """Config for flights to a pose at every trade-off, on a GPU; without one the agent for any craft is better.

        In space of on/off thrusters that turn the craft finely: others are held by fewer policies. Those of
        craft with wheels were imitated for half a minute only (docs/decisions/value.md).
        """
        fits = suits(craft) and not craft.wheels and type(config.settings) in POSES
        if not fits or config.device.startswith("cpu"):
            return None
        if craft.dimension == 3:
            timing = config.timing
            spin = max(PoseProblem(craft, config.settings, timing).spin_steps)
            if not _learns_from_flights(craft) or spin * timing.control_period > _FINE:
                return None
        priced: Any = {"task": "go-to-pose-priced", "settings": POSES[1]()}
        return cls.started(replace(config, algorithm="value", learner={}, **priced))

    @classmethod
    def contestants(cls, config: TrainConfig, folder: Path) -> list[str]:
        """The value function at three trade-offs, of a craft that can be named: no code of a stranger's config."""
        task = "go-to-pose-priced" if type(config.settings) in POSES else config.task
        with suppress(ConfigError):
            name = f"value:{task}-{craft_of(config).dimension}d@{config.spacecraft}"
            return [f"{name}#{folder},{x}" for x in ("0", "0.5", "1")]
        return []

    @classmethod
    def started(cls, config: TrainConfig) -> TrainConfig:
        """Config with hyper-parameters known to work."""
        is_small = config.device.startswith("cpu")
        flies = _learns_from_flights(craft_of(config))
        sizes: Any = _SMALL_POLICY if is_small else {"n_envs": _ENVS[flies]}
        ppo = replace(config.ppo, **_POLICY | sizes)
        learner = config.learner | (_SMALL if is_small else {})
        from_nothing = learner["units"] != ValueSettings.units
        return replace(
            config,
            ppo=ppo,
            learner=learner,
            total_timesteps=_ITERATIONS[flies][from_nothing] * ppo.n_envs * ppo.n_steps,
            report_interval=40,
            curriculum=(),
            solved_share=None,
            compiled=None if is_small else True,
        )

    @classmethod
    def making(cls, config: TrainConfig, craft: Any, own: ValueSettings) -> Any:
        """Constructor of the learner.

        Raises:
            ConfigError: the training has conditions.
        """
        if config.conditions.or_none is not None:
            raise ConfigError(
                "the algorithm 'value' computes with the craft as designed: leave out the conditions, or train "
                'with the algorithm "ppo".'
            )
        return partial(ValueLearner, own=own)
