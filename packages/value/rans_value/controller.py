"""Controllers that fly by a value function, of a run folder or of those that come with RANS."""

from __future__ import annotations

from contextlib import suppress
from copy import copy
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from rans import TASKS, Conditions
from rans.extend import ConfigError, RunFolder, Spacecraft, State, Timing, reading
from rans_value.belief import Belief
from rans_value.goal_frame import GoalFrame
from rans_value.greedy import Greedy
from rans_value.network import ValueNetwork
from rans_value.problem import TRADE_OFF, PoseProblem
from rans_value.varied import VariedProblem

POSES = (TASKS["go-to-pose"], TASKS["go-to-pose-priced"])
"""Flights to a pose, to which a value function of either flies at any trade-off."""


def suits(craft: Spacecraft) -> bool:
    """Whether there is such a value function: of craft with thrusters and, in the plane, wheels, without a tank."""
    others = craft.command_count - craft.thruster_count
    has_only_wheels = others == len(craft.stores) == craft.wheel_count
    return has_only_wheels and (craft.dimension == 2 or not others)


def check_craft(craft: Spacecraft) -> None:
    """Reject (`ConfigError`) craft that have no such value function."""
    if not suits(craft):
        raise ConfigError(
            "value functions are of craft with thrusters alone, in the plane also with wheels, without a tank, "
            f'and {craft.name} is no such craft: fly any-craft, or train with the algorithm "ppo".'
        )


_KEPT = 0.6
"""Part of the tolerance of the position within which flights under conditions are held by values of flights as
designed."""


class _BetweenSpins:
    """Values of craft under conditions by those of the design: means at the next spins that its pulses can reach.

    Other spins come to rest by no pulses of the design, and its value function has hardly seen any.
    """

    def __init__(self, value: ValueNetwork) -> None:
        self.mean = value.mean
        self._value = value

    def __call__(self, state: Tensor) -> Tensor:
        """Values of states of a `VariedProblem`, s."""
        designed = torch.cat((state[:6], state[-1:]))
        pulse = self._value.problem.spin_steps[0]
        pulses = designed[5] / pulse
        low = pulses.floor()
        below, above = (
            self._value(torch.cat((designed[:5], x[None] * pulse, designed[6:])))
            for x in (low, low + 1.0)
        )
        return torch.lerp(below, above, pulses - low)


class GreedyController:
    """Commands by the value function of a run, searched two periods ahead, with limits three; a `rans.Controller`.

    >>> rans.evaluate(GreedyController("runs/mine"))  # doctest: +SKIP

    Args:
        folder: run folder of a training by this algorithm.
        trade_off: trade-off between time and impulse, 0 (fast) to 1 (thrifty), where goals note none.
        position_tolerance: tolerance, m, at most that of the training; None: that of the training.

    Raises:
        ConfigError: it is no such folder, a trade-off is not from 0 to 1, or the tolerance not above 0 and at most
            that of the training.
    """

    observes = False
    slow = 32
    files: tuple[Path, ...] = ()
    """What decides its commands."""

    def __init__(
        self,
        folder: str | Path,
        trade_off: float | str = TRADE_OFF,
        position_tolerance: float | None = None,
    ) -> None:
        run = RunFolder(Path(folder))
        config = run.config()
        if config.algorithm != "value" or not run.has_checkpoint:
            raise ConfigError(
                f"{folder} has no value function: train with --set algorithm=value, and keep the checkpoint."
            )
        priced: Any = TASKS["go-to-pose-priced"]()
        self._trade_off: float = priced.parts()[str(trade_off)].held_trade_off
        settings: Any = config.settings
        most: float = settings.tolerances()["position"]
        if position_tolerance is not None and not 0.0 < position_tolerance <= most:
            raise ConfigError(
                f"position_tolerance must be above 0 and at most that of the training, {most:g} m, got "
                f"{position_tolerance!r}."
            )
        self.files = run.config_file, run.checkpoint_file
        self._setup = run.spacecraft(), settings, config.timing
        self._tolerance = position_tolerance or most
        kind = PoseProblem if config.conditions.or_none is None else VariedProblem
        problem = kind(*self._setup, position_tolerance)
        value = ValueNetwork(problem, torch.zeros(problem.rows, 2), config.learner["units"])
        with reading(run.config_file):  # which the checkpoint may not fit
            value.load_state_dict(run.load_checkpoint("cpu")["learner"]["average"])
        numbers = value.state_dict().values()
        if not all(x.isfinite().all() for x in numbers) or not (value.spread > 0.0).all():
            raise ConfigError(
                f"{run.checkpoint_file} has a value function that cannot be flown: a weight is no finite number, "
                "or a spread not above 0."
            )
        self.name = f"{'installed ' * (run.path.parent == SHIPPED)}value of {run.path.name}"
        self.greedy = self._designed = Greedy(problem, value)
        # In space some spins that arrive would not come to rest, and an end by success is an arrival anyway.
        arrives = problem.dimension == 2 and not problem.frame.ends_well
        self._outside = Greedy(problem, value, arrives)
        self._belief: Belief | None = None

    def expecting(self, conditions: Conditions | None) -> GreedyController:
        """The controller that estimates in flight what conditions may be, in the plane without limits or an end.

        See `rans_value.belief`. If its training had none it keeps to a part of the tolerance of the position. None:
        all is as designed.
        """
        made = copy(self)
        made.greedy, made._belief = self._designed, None
        problem = made.greedy.problem
        craft, task, timing = self._setup
        is_modelled = craft.dimension == 2 and not craft.wheels
        if conditions is not None and is_modelled and type(task) in POSES:
            if not isinstance(problem, VariedProblem):
                kept = craft, task, timing, _KEPT * self._tolerance
                problem = VariedProblem(*kept)
                value: Any = copy(made.greedy.value)
                value.problem = PoseProblem(*kept)
                made.greedy = Greedy(problem, _BetweenSpins(value))
            made._belief = Belief(problem, conditions, timing)
        return made

    def reset(self, count: int) -> None:
        """Begin ``count`` flights; what is remembered are estimates under conditions."""
        if self._belief is not None:
            self._belief.reset(count)

    @torch.no_grad()
    def act(self, state: State, goal: State, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) of states."""
        belief, like, problem = self._belief, self.greedy.value.mean, self.greedy.problem
        number = like if belief is None else like.double()
        seen = problem.frame.relative(state, goal, number, self._trade_off)
        seen = problem.with_parameters(seen) if belief is None else belief.read(seen).to(like)
        command = seen.new_zeros(seen.shape[1], problem.craft.command_count)
        # Only flights that go on. Near limits a period more: errors of the value lose flights there.
        goes_on = ~problem.frame.is_over(seen)
        periods = 3 if problem.limits else 2
        holds = problem.inside(seen)[1] | (belief is not None)
        for greedy, chosen in ((self.greedy, holds), (self._outside, ~holds)):
            chosen = chosen & goes_on
            if chosen.any():
                command[chosen] = greedy.best(seen[:, chosen], periods)[0]
        if belief is not None:
            belief.sent(command)
        return command.numpy()


SHIPPED = Path(__file__).parent / "data"
"""Folders of the value functions that come with RANS, with numbers of half precision."""


class Newest(GreedyController):
    """Controller by the value function of a craft in the folder ``runs``, else by one of `SHIPPED`.

    It flies at the trade-off of the task, or at its own where goals note none. It is the contestant ``value``,
    as in ``value:go-to-pose-priced-2d@mine.toml#0.5``, or, of a run folder that is named, ``...#runs/mine,0.5``.

    Raises:
        ConfigError: there is none, or ``runs`` has several, of which one is to be named.
    """

    has_trade_off: ClassVar[bool] = True

    def __init__(
        self, craft: Spacecraft, task: Any, timing: Timing, trade_off: float | str = TRADE_OFF
    ) -> None:
        check_craft(craft)
        frame = GoalFrame(craft, task, timing)
        named, _, number = str(trade_off).rpartition(",")
        runs = Path("runs").glob("**/config.json")
        own = [Path(named) / "config.json"] if named else sorted(runs)
        found: dict[bool, list[Path]] = {False: [], True: []}
        for file in (*own, *([] if named else SHIPPED.glob("*/config.json"))):
            run = RunFolder(file.parent)
            # Other folders may need packages that are not here, and files of other programs have the same name.
            with suppress(ConfigError):
                with reading(file) as table:
                    is_one = table["algorithm"] == "value"
                if not (is_one and run.has_checkpoint):
                    continue
                config = run.config()
                if (
                    run.spacecraft() == craft
                    and config.timing.control_period == timing.control_period
                    and GoalFrame(craft, config.settings, timing).serves(frame)
                ):
                    found[config.conditions.or_none is not None].append(run.path)
        for folders in found.values():
            if len(several := [folder for folder in folders if folder.parent != SHIPPED]) > 1:
                raise ConfigError(
                    f"{', '.join(map(str, several))} have a value function of {craft.name}: name the one to fly, "
                    f"as in value:TASK-{craft.dimension}d@CRAFT#{several[0]},{TRADE_OFF:g}."
                )
        if any(found.values()):
            how = number, frame.tolerances["position"]
            plain, varied = (folders or found[not kind] for kind, folders in found.items())
            super().__init__(plain[0], *how)
            self._varied = GreedyController(varied[0], *how)
            self.files += self._varied.files
            if task.goal_notes is None:
                for made in (self, self._varied):
                    made.name += f"#{made._trade_off:g}"
            return
        raise ConfigError(
            f"{named or 'no folder in runs/'} has {'no' if named else 'a'} value function of {craft.name} at "
            f"{timing.control_period:g} s for what {type(task).__name__} asks, or with a larger tolerance of the "
            "position: train one on a GPU, as with rans train go-to-pose --set algorithm=value."
        )

    def expecting(self, conditions: Conditions | None) -> GreedyController:
        """As that of a folder: the newest whose training had conditions, unless thrusters fail, and never partly.

        Values of the design hold more of those that are dead or wholly open (docs/decisions/value.md).
        """
        is_whole = conditions and conditions.has_faults and "weak" not in conditions.faults.kinds
        if conditions is None or is_whole:
            return super().expecting(conditions)
        return self._varied.expecting(conditions)
