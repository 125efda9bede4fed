"""One spacecraft as an ordinary Gymnasium environment, whatever moves it, and what all interfaces share."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from rans.effectors.commands import action_space, check
from rans.episode import Episode, Guard, Mover, Setup, World, step
from rans.errors import ConfigError, brief, checked
from rans.model.dynamics import State
from rans.model.fields import leaves, map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import USUAL, load_spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import load_conditions
from rans.scenario import Scenario, draws, scenario
from rans.tasks import TASKS, Task
from rans.tasks.derived import example
from rans.tasks.observation_terms import Dimension
from rans.tasks.rewards import paid


class Environment(gymnasium.Env[np.ndarray, np.ndarray]):
    """One spacecraft flying one task: NumPy in and out, float64 inside.

    Everything but the motion: episodes by number, observation, reward, ends and pictures. Episodes end by
    themselves: ``terminated`` when the task has failed or the mission is won, otherwise ``truncated`` after
    ``timing.episode_steps``.

    Observation: (10,) in the plane or (22,) in space, float32, `rans.tasks.observation_columns`.
    Action: (commands,), as `rans.model.spacecraft.Spacecraft.commands` lists them: usually 0 (shut) or 1 (open).
    ``info``: "reward_terms" and "errors" by name, with constraints also "margins"; at the end of an episode
    "is_success", whether the mission was won, or time ran out within the task's tolerances.

    Args:
        task_name: of `rans.tasks.TASKS`, or MODULE:NAME.
        dimension: 2 (plane) or 3 (space).
        spacecraft: name, TOML file or object; None: the usual one of this dimension.
        task: settings; None: the defaults.
        timing: control period, accuracy and length of an episode; None: the task's own.
        render_mode: None; "rgb_array": `render` gives frames; "human": every `reset` and `step` shows one
            in the browser, at real time (see `rans.window.Window`).
        conditions: randomization, disturbances, faults and sensors, by name, TOML file or as such; None: none.
        guard: safety filter between actions and effectors; None: every action is taken.
        plain: taken as `rans.fast.SpacecraftVectorEnv` takes it, and changes nothing: one spacecraft always
            flies by its equations as they are written, on plain numbers.

    Raises:
        ConfigError: one of these does not exist or does not fit the others.
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 5}  # noqa: RUF012  (Gymnasium's)

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
        self.render_mode = checked_render_mode(render_mode)
        self.craft, self.task = choose(task_name, dimension, spacecraft, task)
        self.timing = self.task.timing if timing is None else checked("timing", timing, Timing)
        self.observation_space = observation_space(self.task, dimension)
        self.action_space = action_space(self.craft)
        self.metadata = {**self.metadata, "render_fps": 1.0 / self.timing.control_period}
        self._seed: int | None = None
        self._episode = 0
        met = None if conditions is None else load_conditions(conditions)
        self._world = World(Setup(self.craft, self.task, self.timing, met, guard))
        self._move = self._mover()
        self._now = None
        self._scene: Any = None
        self._window: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start the next episode: number 0 of a seed, by default the next of the last, or of a random one.

        Raises:
            ConfigError: the options hold anything but {"scenario": `Scenario`}, to be flown in its place.
        """
        seed = int(seed) if isinstance(seed, np.integer) else seed
        super().reset(seed=seed)
        if seed is None and self._seed is not None:
            self._episode += 1
        else:
            self._seed = int(self.np_random.integers(2**63)) if seed is None else seed
            self._episode = 0
        chosen = scenario(self.task, self.craft.dimension, self._seed, self._episode)
        chosen = (
            _given_scenario(checked("the options of reset", options or {}, dict), chosen) or chosen
        )
        self._draws = draws(self._seed, 1, self._episode)
        self._now: Episode | None = _plain(
            self._world.begin(chosen.start, chosen.goal, 0, self._draws)
        )
        self._command = (0.0,) * len(self.craft.commands)
        self._trail: list[tuple[float, ...]] = []
        self._show()
        return self._observe(), {"errors": self._errors()}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Hold the commands for one control period.

        Raises:
            ConfigError: the craft cannot follow the action.
            gymnasium.error.ResetNeeded: there was no `reset` yet.
        """
        before = self._running()
        values = _numbers(action)
        check(self.craft, values)
        self._trail.append(before.state.p.columns())
        outcome = step(
            self._world, before, tuple(values.astype(float).tolist()), self._draws, self._move
        )
        self._now = _plain(outcome.episode)
        self._command = outcome.command
        self._show()
        terminated = bool(outcome.terminated)
        truncated = bool(outcome.truncated)
        terms, reward = paid(outcome.terms, np.bool_(terminated))
        info: dict[str, Any] = {
            "reward_terms": {name: float(term) for name, term in terms.items()},
            "errors": self._errors(),
        }
        if outcome.margins:
            info["margins"] = {name: float(margin) for name, margin in outcome.margins.items()}
        if terminated or truncated:
            info["is_success"] = bool(outcome.success)
        return self._observe(), float(reward), terminated, truncated, info

    @abstractmethod
    def _mover(self) -> Mover | None:
        """Who moves the spacecraft; None: our equations."""

    def render(self) -> Any:
        """A frame (480, 640, 3) uint8 in the mode "rgb_array"; see `rans.drawing.Scene`."""
        self._running()
        return self._draw() if self.render_mode == "rgb_array" else None

    @property
    def state(self) -> State:
        """The spacecraft's, of numbers; raises `ResetNeeded` before the first `reset`."""
        return self._running().state

    @property
    def goal(self) -> State:
        """The episode's, of numbers; raises as `state`."""
        return self._running().goal

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _draw(self) -> np.ndarray:
        now = self._running()
        if self._scene is None:
            from rans.drawing import Scene

            self._scene = Scene(self.craft, self.task)
        return self._scene.render(now.state, now.goal, self._command, self._trail)

    def _show(self) -> None:
        """Show the newest frame if the render mode asks for it."""
        if self.render_mode != "human":
            return
        if self._window is None:
            from rans.window import Window

            self._window = Window(self.metadata["render_fps"])
        self._window.show(self._draw())

    def _running(self) -> Episode:
        if self._now is None:
            raise ResetNeeded("call reset() before step() and render().")
        return self._now

    def _observe(self) -> np.ndarray:
        seen = self._world.observe(self._running(), self._draws)
        return np.array([float(np.squeeze(x)) for x in seen], dtype=np.float32)

    def _errors(self) -> dict[str, float]:
        now = self._running()
        return {name: float(x) for name, x in self.task.errors(now.state, now.goal).items()}


def dense(given: Any) -> Any:
    """A tensor of torch without gradients, as it lies in memory; anything else as it is.

    Raises:
        ConfigError: a tensor that is sparse, nested, quantized or without numbers.
    """
    if not hasattr(given, "detach"):
        return given
    kinds = {
        "nested": given.is_nested,
        "quantized": given.is_quantized,
        "meta": given.is_meta,
        str(given.layout): str(given.layout) != "torch.strided",
    }
    if odd := [kind for kind, true in kinds.items() if true]:
        raise ConfigError(
            f"actions and masks of torch must be ordinary tensors, got a {odd[0]} one; "
            "to_dense() makes one of most others."
        )
    return given.detach().resolve_conj().resolve_neg()


def array(actions: Any) -> np.ndarray:
    """Actions that are no tensor as an array, its numbers as torch knows them too.

    Raises:
        ConfigError: rows of them are of different lengths.
    """
    try:
        given = np.asarray(actions)
    except ValueError as error:
        raise ConfigError(
            f"actions must be numbers in rows of one length, got {brief(actions)}."
        ) from error
    wide = given.dtype.kind == "f" and given.dtype.itemsize > 8
    return given.astype(np.float64 if wide else given.dtype.newbyteorder("="), copy=False)


def _numbers(action: Any) -> np.ndarray:
    """Actions of NumPy or torch, in a dtype that NumPy knows."""
    given = dense(action)
    if given is action:
        return array(action)
    return given.cpu().numpy() if given.is_complex() else given.cpu().double().numpy()


def _plain(episode: Episode) -> Episode:
    """The same of numbers, but for whole ones."""
    whole = lambda x: np.asarray(x).dtype.kind in "iu"  # noqa: E731
    return map_leaves(lambda x: x if whole(x) else float(np.squeeze(x)), episode)


def _given_scenario(options: dict[str, Any], like: Scenario) -> Scenario | None:
    """The scenario among the options of `reset`, if there is one: as many numbers as another one has."""
    for key in options:
        if key != "scenario":
            raise ConfigError(f'unknown option {key!r} of reset; the only one is "scenario".')
    given = options.get("scenario")
    if given is None:
        return None
    widths = [len(leaves(s)) for s in (like.start, like.goal)]
    numbers = [leaves(s) for s in (given.start, given.goal)] if isinstance(given, Scenario) else []
    if [len(x) for x in numbers] != widths or not all(np.isfinite(x).all() for x in numbers):
        raise ConfigError(
            "the scenario of reset must be a rans.scenario.Scenario whose start and goal are "
            f"{widths[0]} and {widths[1]} finite numbers, got {given!r}."
        )
    return given


def observation_space(
    task: Task, dimension: Dimension, dtype: type[np.floating[Any]] = np.float32
) -> spaces.Box:
    """The columns of a task's observation, within their bounds; without one, any finite float32 number.

    Gymnasium's and SB3's checkers ask for finite bounds.
    """
    bounds = np.minimum(example(task, dimension).bounds(), np.finfo(np.float32).max).astype(dtype)
    return spaces.Box(-bounds, bounds, dtype=dtype)


def checked_render_mode(render_mode: str | None) -> str | None:
    """The render mode; `ConfigError`, unless environments have it."""
    if render_mode not in (None, "human", "rgb_array"):
        raise ConfigError(f'render_mode must be None, "human" or "rgb_array", got {render_mode!r}.')
    return render_mode


def choose(
    task_name: str,
    dimension: Dimension,
    spacecraft: str | Path | Spacecraft | None,
    task: Task | None,
) -> tuple[Spacecraft, Task]:
    """Spacecraft and task of an environment, from what `rans.environment.Environment` takes.

    Raises:
        ConfigError: there is no such spacecraft or task, or it does not fit the environment.
    """
    wanted = TASKS[task_name]
    usual = wanted.spacecraft or USUAL[dimension]
    craft = load_spacecraft(usual if spacecraft is None else spacecraft)
    if craft.dimension != dimension:
        raise ConfigError(
            f"this environment is for spacecraft of dimension {dimension}, got {craft.name!r} "
            f"of dimension {craft.dimension}; environments named 2D fly in the plane, those "
            "named 3D in space."
        )
    if task is None:
        return craft, wanted()
    if isinstance(task, Task) and not isinstance(task, wanted):
        raise ConfigError(
            f"this environment is for {wanted.__name__} settings, got {task!r}; choose the "
            "environment named after the task."
        )
    return craft, checked("task", task, wanted)
