"""Controllers that fly by a value function, of a run folder or of those that come with RANS."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import suppress
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from rans import (
    TASKS,
    BodyConditions,
    Conditions,
    DisturbanceConditions,
    FaultConditions,
    RansWarning,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.extend import (
    REST_SPIN,
    ConfigError,
    RunFolder,
    Spacecraft,
    State,
    Timing,
    reading,
)
from rans_value.belief import Belief
from rans_value.common import ATTITUDE, WEIGHTS, CommonProblem, CommonValue
from rans_value.goal_frame import GoalFrame
from rans_value.greedy import Greedy
from rans_value.network import ValueNetwork
from rans_value.problem import TRADE_OFF, PoseProblem, parted

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


_OFF = 0.8 * REST_SPIN
"""Spin, rad/s, by which a state is off the sums of whole pulses for the values of a fit to one craft: from 5
degrees/s on none of 48 flights was solved."""


_FAILURES: Any = ("dead", "stuck-open")
"""Kinds of failures that are expected where nobody tells any."""


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
        self._trade_off = _held(trade_off)
        settings: Any = config.settings
        most: float = settings.tolerances()["position"]
        if position_tolerance is not None and not 0.0 < position_tolerance <= most:
            raise ConfigError(
                f"position_tolerance must be above 0 and at most that of the training, {most:g} m, got "
                f"{position_tolerance!r}."
            )
        self.files = run.config_file, run.checkpoint_file
        self._setup = run.spacecraft(), settings, config.timing
        problem = PoseProblem(*self._setup, position_tolerance)
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
        self.greedy = Greedy(problem, value)
        # In space some spins that arrive would not come to rest, and an end by success is an arrival anyway.
        arrives = problem.dimension == 2 and not problem.frame.ends_well
        self._outside = Greedy(problem, value, arrives)

        self._begins = True
        self._by_all: CommonController | None = None
        if flies_common(run.spacecraft(), settings):
            with suppress(ConfigError):  # a craft that is stronger or weaker than all
                self._by_all = CommonController(*self._setup, self._trade_off)

    def reset(self, count: int) -> None:
        """Begin ``count`` flights."""
        self._begins = True

    def expecting(self, conditions: Conditions | None) -> GreedyController | CommonController:
        """The controller that estimates in flight what conditions may be, by the common values where these fly."""
        if conditions is None or self._by_all is None:
            return self
        return self._by_all.expecting(conditions)

    @torch.no_grad()
    def act(self, state: State, goal: State, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) of states."""
        problem = self.greedy.problem
        seen = problem.frame.relative(state, goal, self.greedy.value.mean, self._trade_off)
        command = seen.new_zeros(seen.shape[1], problem.craft.command_count)
        # Only flights that go on. Near limits a period more: errors of the value lose flights there.
        goes_on = ~problem.frame.is_over(seen)
        periods = 3 if problem.limits else 2
        holds = problem.inside(seen)[1]
        # Nearly all spins of the fit were sums of whole pulses: its values know nothing of others.
        steps = seen.new_tensor(problem.spin_steps)[:, None]
        pulses = parted(seen)[3] / steps
        off = goes_on & (((pulses - pulses.round()) * steps).norm(dim=0) > _OFF)
        if self._by_all is not None:
            goes_on = goes_on & ~off
            if off.any():
                command[off] = self._by_all.chosen(seen[:, off])
        elif self._begins and off.any() and not problem.craft.wheels:
            warnings.warn(
                f"{int(off.sum())} of {len(off)} flights begin with a spin that no whole pulses of "
                f"{problem.craft.name} stop, of which {self.name} knows nothing: they may fly away. Fly any-craft.",
                RansWarning,
                stacklevel=2,
            )
        self._begins = False
        for greedy, chosen in ((self.greedy, holds), (self._outside, ~holds)):
            chosen = chosen & goes_on
            if chosen.any():
                command[chosen] = greedy.best(seen[:, chosen], periods)[0]
        return command.numpy()


class CommonController:
    """Commands by the value function of all planar craft, searched two periods ahead; a `rans.Controller`.

    It estimates in flight what thrusters, disturbances and delay do: a file is a claim.

    Args:
        craft: craft in the plane with thrusters alone.
        task: flight to a pose.
        timing: control period and length of a flight.
        trade_off: trade-off between time and impulse, 0 (fast) to 1 (thrifty), where goals note none.

    Raises:
        ConfigError: the craft is stronger or weaker than those of the fit.
    """

    observes = False
    slow = 32

    def __init__(
        self,
        craft: Spacecraft,
        task: Any,
        timing: Timing,
        trade_off: float = TRADE_OFF,
    ) -> None:
        self._problem = CommonProblem(craft, task, timing)
        self._timing = timing
        self._trade_off = trade_off
        self._value = CommonValue(self._problem)
        self._greedy = Greedy(self._problem, self._value)
        self._belief: Belief | None = None
        self.name = "value of all planar craft"
        self.files = (WEIGHTS,)

    def expecting(self, conditions: Conditions | None) -> CommonController:
        """The controller that estimates in flight what conditions may be; None: what no file states exactly."""
        made = copy(self)
        seconds = self._timing.episode_steps * self._timing.control_period
        for one in claims(self._problem, seconds) if conditions is None else [conditions]:
            try:
                made._belief = Belief(self._problem, one, self._timing)
                break
            except ConfigError:  # failures that the craft cannot do without
                if conditions is not None:
                    raise
        return made

    def reset(self, count: int) -> None:
        """Begin ``count`` flights; what is remembered are estimates."""
        if self._belief is not None:
            self._belief.reset(count)

    def chosen(self, seen: Tensor) -> Tensor:
        """Commands (N, n) of states (7, N), or with what is estimated (7 + m, N)."""
        if len(seen) == 7:
            seen = self._problem.with_parameters(seen)
        greedy = copy(self._greedy)
        greedy.value = self._value.of(seen)
        return greedy.best(seen, 2)[0]

    @torch.no_grad()
    def act(self, state: State, goal: State, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) of states."""
        belief, like, problem = self._belief, self._value.mean, self._problem
        number = like if belief is None else like.double()
        seen = problem.frame.relative(state, goal, number, self._trade_off)
        if belief is not None:
            seen = belief.read(seen).to(like)
        command = seen.new_zeros(seen.shape[1], problem.craft.command_count)
        goes_on = ~problem.frame.is_over(seen)
        if goes_on.any():
            command[goes_on] = self.chosen(seen[:, goes_on])
        if belief is not None:
            belief.sent(command)
        return command.numpy()


def _held(trade_off: float | str) -> float:
    """A trade-off as names have it; ConfigError: it is none."""
    priced: Any = TASKS["go-to-pose-priced"]()
    return priced.parts()[str(trade_off)].held_trade_off


def claims(problem: PoseProblem, seconds: float) -> Iterator[Conditions]:
    """What a craft may be beside its file where nobody says it: as `lab`, and thrusters may fail in a flight.

    In half of the flights one may have failed before the start. The first that the craft can do without is meant.
    """
    push = 0.1 * problem.force
    position, attitude, velocity, spin = (
        SensorConditions(noise=x) for x in (0.003, 0.005, 0.006, 0.005)
    )
    for most, kinds in ((2.0, _FAILURES), (1.0, _FAILURES), (1.0, _FAILURES[:1]), (0.0, _FAILURES)):
        failing = FaultConditions(
            (0.0, most), kinds, time=(0.0, seconds), among="recoverable" if most else "any"
        )
        begun = Conditions(
            BodyConditions(mass=(0.8, 1.2), inertia=(0.8, 1.2)),
            ThrusterConditions(thrust=(0.85, 1.15), latency=(0.0, 0.5 * problem.period)),
            replace(failing, count=(0.0, min(most, 1.0)), time=0.0),
            DisturbanceConditions(
                force=(0.0, push), torque=(0.0, 0.1 * problem.craft.radius * push)
            ),
            SensorsConditions(position, attitude, velocity, spin),
        )
        yield replace(begun, others=(replace(begun, faults=failing),))


def flies_common(craft: Spacecraft, task: Any) -> bool:
    """Whether the value function of all planar craft is of such flights."""
    is_planar = craft.dimension == 2 and suits(craft) and not craft.wheels
    return is_planar and type(task) in POSES and task.attitude_tolerance >= ATTITUDE


SHIPPED = Path(__file__).parent / "data"
"""Folders of the value functions that come with RANS, with numbers of half precision."""


class Newest:
    """Controller by the value function of a craft in the folder ``runs``.

    Where ``runs`` has none it is in the plane that of all craft, else one of `SHIPPED`. It flies at the trade-off
    of the task, or at its own where goals note none. It is the contestant ``value``, as in
    ``value:go-to-pose-priced-2d@mine.toml#0.5``, or, of a run folder that is named, ``...#runs/mine,0.5``.

    Raises:
        ConfigError: there is none, or ``runs`` has several, of which one is to be named.
    """

    has_trade_off: ClassVar[bool] = True
    observes = False
    slow = 32
    files: tuple[Path, ...] = ()
    """What it flies by, which evidence is of."""

    def __init__(
        self, craft: Spacecraft, task: Any, timing: Timing, trade_off: float | str = TRADE_OFF
    ) -> None:
        check_craft(craft)
        frame = GoalFrame(craft, task, timing)
        named, _, number = str(trade_off).rpartition(",")
        chosen = _held(number)
        by_all = not named and flies_common(craft, task)
        runs = Path("runs").glob("**/config.json")
        own = [Path(named) / "config.json"] if named else sorted(runs)
        found: list[Path] = []
        for file in (*own, *([] if named or by_all else SHIPPED.glob("*/config.json"))):
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
                    found.append(run.path)
        if len(several := [folder for folder in found if folder.parent != SHIPPED]) > 1:
            raise ConfigError(
                f"{', '.join(map(str, several))} have a value function of {craft.name}: name the one to fly, "
                f"as in value:TASK-{craft.dimension}d@CRAFT#{several[0]},{TRADE_OFF:g}."
            )
        made: Any
        if found:
            made = GreedyController(found[0], chosen, frame.tolerances["position"])
        elif by_all:
            made = CommonController(craft, task, timing, chosen)
        else:
            raise ConfigError(
                f"{named or 'no folder in runs/'} has {'no' if named else 'a'} value function of {craft.name} at "
                f"{timing.control_period:g} s for what {type(task).__name__} asks, or with a larger tolerance of "
                "the position: train one on a GPU, as with rans train go-to-pose --set algorithm=value."
            )
        self.name = made.name + ("" if task.goal_notes is not None else f"#{made._trade_off:g}")
        self.files = made.files
        self._made = self._flown = made

    def expecting(self, conditions: Conditions | None) -> Newest:
        """The controller that estimates in flight what conditions may be."""
        other = copy(self)
        other._flown = self._made.expecting(conditions)
        return other

    def reset(self, count: int) -> None:
        """Begin ``count`` flights."""
        self._flown.reset(count)

    def act(self, state: State, goal: State, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) of states."""
        return self._flown.act(state, goal, observation)
