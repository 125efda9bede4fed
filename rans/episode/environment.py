"""Base class of Gymnasium environments of one spacecraft, and helpers that all environments share.

Two of them exist, in the fast engine and in Drake (`rans.reference`); both must give equal episodes.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded

from rans.base.errors import ConfigError, NamedArguments, brief, checked, whole
from rans.base.inputs import array
from rans.base.registry import typed
from rans.base.settled import settled
from rans.effectors.commands import action_space, check_commands, clipped
from rans.episode.scenario import Scenario, draws, scenario
from rans.episode.step import Episode, Guard, Mover, Setup, World, step
from rans.model.dynamics import State
from rans.model.fields import leaves, map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import USUAL, load_spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import load_conditions
from rans.tasks import TASKS, Task
from rans.tasks.derived import check_dimension, example
from rans.tasks.observation_terms import Dimension
from rans.tasks.rewards import paid


class Environment(NamedArguments, gymnasium.Env[np.ndarray, np.ndarray]):
    """Gymnasium environment of one spacecraft and one task, with NumPy observations and actions and float64 states.

    Derived classes define the motion. An episode ends as ``terminated`` when the task fails or the mission
    succeeds, and otherwise as ``truncated`` after ``timing.episode_steps``.

    Observation: (10,) in the plane or (22,) in space, or more, float32; see `rans.tasks.observation_columns`.
    Action: (commands,), in the order of `rans.model.spacecraft.Spacecraft.commands`; usually 0 (shut) or 1 (open).
    ``info``: "reward_terms" and "errors" by name, "margins" if the task has constraints, and whether a mission has
    succeeded ("is_success"), or for other tasks the state is within the tolerances ("at_goal").

    Args:
        task_name: name in `rans.tasks.TASKS`, or MODULE:NAME.
        dimension: 2 (plane) or 3 (space).
        spacecraft: name, TOML file or object; None: the default one of the task or the dimension.
        task: task settings; None: the defaults.
        timing: control period, substeps, checks and length of an episode; None: those of the task.
        render_mode: None, or "rgb_array": `render` returns frames.
        conditions: domain randomization, disturbances, faults and sensors, as a name, a TOML file or an object;
            None: everything is nominal.
        guard: safety filter between actions and effectors; None: every action is executed.
        plain: accepted as by `rans.SpacecraftVectorEnv`, without effect: a single environment always
            evaluates its equations on plain numbers.

    Raises:
        ConfigError: one of these does not exist or does not fit the others.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 5}  # noqa: RUF012  (Gymnasium's)

    @settled
    def __init__(
        self,
        task_name: str,
        dimension: Dimension,
        *,
        spacecraft: str | Path | Spacecraft | None = None,
        task: Task | None = None,
        timing: Timing | None = None,
        render_mode: str | None = None,
        conditions: str | Path | Conditions | None = None,
        plain: bool = True,
        guard: Guard | None = None,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ConfigError(f'render_mode must be None or "rgb_array", got {render_mode!r}.')
        self.render_mode = render_mode
        self.craft, self.task = choose(task_name, dimension, spacecraft, task)
        self.timing = self.task.timing if timing is None else checked("timing", timing, Timing)
        self.observation_space = observation_space(self.task, dimension)
        self.action_space = action_space(self.craft)
        self.metadata = {**self.metadata, "render_fps": 1.0 / self.timing.control_period}
        self._spec: EnvSpec | None = None
        self._seed: int | None = None
        self._episode = 0
        loaded = None if conditions is None else load_conditions(typed(conditions), self.craft)
        self._world = World(Setup(self.craft, self.task, self.timing, loaded, guard))
        self._move = self._mover()
        self._now = None
        self._scene: Any = None

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]  # an attribute in Gymnasium
        """Specification as registered, with the length of an episode of this environment."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:  # type: ignore[override]
        self._spec = None if spec is None else own_spec(spec, self.task, self.timing)

    @settled
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start the next episode. Begins seed, episode number, draws, command and trail anew.

        Args:
            seed: seed of the episodes, of which this one has number 0; None: the next episode of the last seed, or
                the first one of a random seed.
            options: {"scenario": `Scenario`} to start from this scenario instead; None: a drawn scenario.

        Raises:
            ConfigError: the options have another key or value.
        """
        seed = None if seed is None else whole("the seed", seed, 0, 64)
        super().reset(seed=seed)
        if seed is None and self._seed is not None:
            self._episode += 1
        else:
            self._seed = int(self.np_random.integers(2**63)) if seed is None else seed
            self._episode = 0
        chosen = scenario(self.task, self.craft.dimension, self._seed, self._episode)
        chosen = (
            _scenario_in(checked("the options of reset", options or {}, dict), chosen) or chosen
        )
        self._draws = draws(self._seed, 1, self._episode)
        self._now: Episode | None = _plain(
            self._world.begin(chosen.start, chosen.goal, 0, self._draws)
        )
        self._command = (0.0,) * self.craft.command_count
        self._trail: list[tuple[float, ...]] = []
        return self._observe(), {"errors": self._errors()}

    @settled
    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Hold the commands for one control period.

        Raises:
            ConfigError: the action has a wrong shape or is out of range.
            gymnasium.error.ResetNeeded: `reset` has not been called.
        """
        before = self._running()
        values = array("actions", action)
        check_commands(self.craft, values)
        values = clipped(self.craft, values.astype(float))
        self._trail.append(before.state.p.columns())
        outcome = step(self._world, before, tuple(values.tolist()), self._draws, self._move)
        self._now = _plain(outcome.episode)
        self._command = outcome.command
        terminated = bool(outcome.terminated)
        truncated = bool(outcome.truncated)
        # Random numbers of a step, such as those of thrusts, are arrays of one.
        terms, reward = paid(outcome.terms, np.bool_(terminated))
        info: dict[str, Any] = {
            "reward_terms": {name: float(np.squeeze(term)) for name, term in terms.items()},
            "errors": self._errors(),
            # In every step, as a wrapper may end the episode in any.
            self.task.end_key: bool(outcome.reached),
        }
        if outcome.margins:
            info["margins"] = {
                name: float(np.squeeze(margin)) for name, margin in outcome.margins.items()
            }
        return self._observe(), float(np.squeeze(reward)), terminated, truncated, info

    @abstractmethod
    def _mover(self) -> Mover | None:
        """Function that moves the spacecraft; None: the equations of `rans.model.dynamics`."""

    def render(self) -> Any:
        """Frame (480, 640, 3), uint8, in the mode "rgb_array", else None; see `rans.episode.drawing.Scene`."""
        now = self._running()
        if self.render_mode is None:
            return None
        if self._scene is None:
            from rans.episode.drawing import Scene

            self._scene = Scene(self.craft, self.task)
        return self._scene.render(now.state, now.goal, self._command, self._trail)

    @property
    def state(self) -> State:
        """State of the spacecraft, of numbers.

        Raises:
            gymnasium.error.ResetNeeded: `reset` has not been called.
        """
        return self._running().state

    @property
    def goal(self) -> State:
        """Goal of the episode, of numbers.

        Raises:
            gymnasium.error.ResetNeeded: `reset` has not been called.
        """
        return self._running().goal

    def _running(self) -> Episode:
        if self._now is None:
            raise ResetNeeded("call reset() before step() and render().")
        return self._now

    def _observe(self) -> np.ndarray:
        columns = self._world.observe(self._running(), self._draws)
        observation = np.array([float(np.squeeze(x)) for x in columns], dtype=np.float32)
        return within(self.observation_space, observation)

    def _errors(self) -> dict[str, float]:
        now = self._running()
        return {name: float(x) for name, x in self.task.errors(now.state, now.goal).items()}


def _plain(episode: Episode) -> Episode:
    """The episode with floats in place of arrays; whole numbers stay."""
    whole = lambda x: np.asarray(x).dtype.kind in "iu"  # noqa: E731
    return map_leaves(lambda x: x if whole(x) else float(np.squeeze(x)), episode)


def _scenario_in(options: dict[str, Any], like: Scenario) -> Scenario | None:
    """Scenario in the options of `reset`, checked against one of the same shape; None if there is none.

    The given scenario replaces what the seed would draw; conditions are drawn as before.
    """
    for key in options:
        if key != "scenario":
            raise ConfigError(f'unknown option {key!r} of reset; the only one is "scenario".')
    chosen = options.get("scenario")
    if chosen is None:
        return None
    widths = [len(leaves(s)) for s in (like.start, like.goal)]
    is_scenario = isinstance(chosen, Scenario)
    numbers = [leaves(s) for s in (chosen.start, chosen.goal)] if is_scenario else []
    if [len(x) for x in numbers] != widths or not all(np.isfinite(x).all() for x in numbers):
        raise ConfigError(
            "the scenario of reset must be a rans.episode.scenario.Scenario whose start and goal are "
            f"{widths[0]} and {widths[1]} finite numbers, got {chosen!r}."
        )
    return chosen


def observation_space(
    task: Task, dimension: Dimension, dtype: type[np.floating[Any]] = np.float32
) -> spaces.Box:
    """Gymnasium space of a task's observation, with the bounds of its columns.

    Columns without a bound have the largest float32 number, because the checkers of Gymnasium and SB3 require
    finite bounds.
    """
    bounds = np.minimum(example(task, dimension).bounds(), np.finfo(np.float32).max).astype(dtype)
    return spaces.Box(-bounds, bounds, dtype=dtype)


def within(space: Any, observation: np.ndarray) -> np.ndarray:
    """An observation within the bounds of its space, a Box, which rounding breaks by parts of 1e-7.

    Columns without a bound, whose space has the largest float32 number, are as they are.
    """
    high = np.where(space.high < np.finfo(np.float32).max, space.high, np.inf)
    return np.clip(observation, -high, high)


def own_spec(spec: EnvSpec, task: Task, timing: Timing) -> EnvSpec:
    """Specification of an environment with this task and timing.

    The registered reward threshold is that of the default settings and timing of a task. Others have none.
    """
    usual = task == type(task)() and timing == task.timing
    return replace(
        spec,
        max_episode_steps=timing.episode_steps,
        reward_threshold=spec.reward_threshold if usual else None,
    )


def choose(
    task_name: str,
    dimension: Dimension,
    spacecraft: str | Path | Spacecraft | None,
    task: Task | None,
) -> tuple[Spacecraft, Task]:
    """Spacecraft and task of an environment, from the arguments of `rans.episode.environment.Environment`.

    Raises:
        ConfigError: there is no such spacecraft or task, or it does not fit the environment.
    """
    if isinstance(task_name, Task):
        raise ConfigError(
            f"an environment is made by the name of its task, and settings are given as task=, as in "
            f"('go-to-pose', 2, task=rans.GoToPose()); got {brief(task_name)} as the name."
        )
    task_class = TASKS[typed(task_name)]
    if dimension not in USUAL:
        raise ConfigError(
            f"dimension must be 2 (in the plane) or 3 (in space), got {brief(dimension)}."
        )
    if dimension not in task_class.dimensions:
        check_dimension(task_class(), dimension)
    usual = task_class.spacecraft or USUAL[dimension]
    craft = load_spacecraft(usual if spacecraft is None else typed(spacecraft))
    if craft.dimension != dimension:
        raise ConfigError(
            f"this environment is for spacecraft of dimension {dimension}, got {craft.name!r} "
            f"of dimension {craft.dimension}; environments named 2D fly in the plane, those "
            "named 3D in space."
        )
    if task is None:
        return craft, task_class()
    if isinstance(task, Task) and not isinstance(task, task_class):
        raise ConfigError(
            f"this environment is for {task_class.__name__} settings, got {task!r}; choose the "
            "environment named after the task."
        )
    return craft, checked("task", task, task_class)
