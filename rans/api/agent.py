"""An agent or a controller as an object: act, evaluate, compare, view, export and save."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rans.api.agent_data import AgentData
from rans.api.names import conditions_if_named, load_spacecraft, load_task
from rans.base.abilities import PUBLIC
from rans.base.errors import ConfigError, brief
from rans.base.inputs import episode_starts, observation_array
from rans.base.pretrained import FOR_ANY_CRAFT
from rans.base.settled import settled, settled_alone
from rans.episode.scenario import EVALUATION_SEED
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import USUAL
from rans.randomization.conditions import Conditions
from rans.tasks import Task
from rans.tasks.derived import check_dimension

if TYPE_CHECKING:
    from rans.api.pages import Replay
    from rans.episode.flight import Flight
    from rans.evaluation.compare.run import Comparison
    from rans.evaluation.fly.episodes import EngineName
    from rans.evaluation.measure.aggregate import Metrics
    from rans.model.dynamics import State

_COPIED = ("config.json", "spacecraft.toml", "metrics.jsonl", "card.json")
"""Files of a run that `Agent.save` copies beside the policy."""


class Agent(AgentData):
    """An agent or a controller with the spacecraft, the task and the conditions that it flies.

    >>> agent = rans.load_agent("go-to-pose-2d")
    >>> agent
    <go-to-pose-2d: GoToPose for floating-platform>
    >>> observation, _ = gymnasium.make("rans/GoToPose2D-v0").reset(seed=0)
    >>> agent.act(observation).shape
    (8,)
    >>> agent.evaluate(episodes=16)["solved"].value
    100.0

    `rans.train` and `rans.load_agent` return one. All functions of `rans` that take the name of an agent take an
    `Agent` as well.
    """

    def under(self, conditions: str | Path | Conditions | None) -> Agent:
        """The same agent, to be evaluated under other conditions: a name, a file or a `Conditions`; None: its own.

        Raises:
            ConfigError: there are no such conditions.
        """
        return Agent(self.run.under(conditions_if_named(conditions)), self.spec)

    def act(self, observation: Any) -> np.ndarray:
        """The deterministic action for an observation, of an agent without a memory.

        Args:
            observation: (width,) or (N, width), as the task's environments give it.

        Returns:
            (commands,) or (N, commands), as the environment's action space takes it.

        Raises:
            ConfigError: the agent has a memory, which belongs to an episode; or see `predict`.
        """
        action, memory = self.predict(observation)
        if memory is not None:
            raise ConfigError(
                f"{self.name} has a memory, which belongs to an episode: ask for action, memory = "
                "agent.predict(observation, memory), with None at the beginning, or let rans.Pilot(agent, env) "
                "fly it in a Gymnasium loop."
            )
        return action

    @settled
    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """The action for an observation and the memory after it, as Stable-Baselines3's ``predict``.

        Args:
            observation: (width,) or (N, width), of NumPy or torch.
            state: memory that the step before gave; None where all episodes begin.
            episode_start: (N,) truth values, or zeros and ones, where an episode begins; None: nowhere.
            deterministic: whether to take the most probable action instead of a sample.

        Raises:
            ConfigError: one of these is of another width, number or kind, or this is a controller that decides from
                the state, which an observation does not have.
        """
        from rans.effectors.commands import action_space, of_outputs
        from rans.evaluation.fly.agent import Agent as Network
        from rans.evaluation.fly.user_policy import UserPolicy
        from rans.policy.predict import predict

        controller = self.run.controller
        observation = observation_array(observation)
        starts = episode_starts(episode_start, observation.size // observation.shape[-1])
        dtype = action_space(self.craft).dtype
        # A network of RANS, then policies of other libraries and exported agents; all may have a memory.
        if isinstance(controller, Network):
            output, memory = predict(controller.network, observation, state, starts, deterministic)
            commands = np.stack(
                [np.asarray(x) for x in of_outputs(self.craft, tuple(np.moveaxis(output, -1, 0)))],
                axis=-1,
            )
            return commands.astype(dtype), memory
        if not isinstance(controller, UserPolicy):
            raise ConfigError(
                f"{self.name} decides from the state, which an observation does not have: "
                "rans.Pilot(agent, env) flies it in a Gymnasium loop."
            )
        rows = observation.reshape(-1, observation.shape[-1])
        commands, memory = controller.decide(rows, state, starts)
        return commands.reshape(*observation.shape[:-1], -1).astype(dtype), memory

    def fly(
        self,
        episodes: int = 1,
        *,
        seed: int = EVALUATION_SEED,
        engine: EngineName = "fast",
        first: int = 0,
        start: State | None = None,
        goal: State | None = None,
    ) -> Flight:
        """Fly episodes from the starts that agents are judged on: states and commands over time.

        >>> rans.load_agent("go-to-pose-2d").fly(2)
        <Flight of go-to-pose-2d: 2 episodes of 25 s with floating-platform (fast engine)>

        Args:
            episodes: number of episodes.
            seed: random seed of starts, goals and conditions.
            engine: what computes the motion: "fast" (RANS's own equations), or "drake".
            first: number of the first episode.
            start: start of all episodes, as `rans.state` makes it; None: sampled. Without conditions one episode
                flies from it, because all would be the same.
            goal: goal of all episodes, as `rans.state` makes it; None: sampled.

        Raises:
            ConfigError: the engine does not exist, a number is out of its range, or start or goal is no state of
                the craft's dimension.
        """
        from rans.api.judging import flown, own_endpoints

        return flown(self.run, episodes, seed, engine, first, own_endpoints(start, goal))

    def evaluate(self, **options: Any) -> Metrics:
        """Fly from fixed starts, and return metrics with 95 % intervals; options as for `rans.evaluate`."""
        from rans.api.judging import evaluate

        return evaluate(self, **options)

    def compare(self, *others: Any, **options: Any) -> Comparison:
        """Compare with agents, controllers and the optimum from the same starts; options as for `rans.compare`."""
        from rans.api.judging import compare

        return compare(self, *others, **options)

    def stress(self, *others: Any, **options: Any) -> Any:
        """Fly under one disturbance at a time, at increasing magnitude; options as for `rans.stress`."""
        return PUBLIC["stress"](self, *others, **options)

    def assure(self, **options: Any) -> Any:
        """Bound the failure probability; options as for `rans.assure`."""
        return PUBLIC["assure"](self, **options)

    def view(self, *others: Any, **options: Any) -> Replay:
        """Fly, and return a page that replays the flights in three dimensions; options as for `rans.view`."""
        from rans.api.pages import view

        return view(self, *others, **options)

    def playground(self, file: str | Path, seed: int = EVALUATION_SEED, episode: int = 0) -> Path:
        """Write a page (.html) in which the agent flies in the browser, offline, and return its path.

        Who reads it moves the goal, lets thrusters fail, and adds delay and noise.

        Args:
            file: page to write.
            seed: of the starts.
            episode: number of the first start.

        Raises:
            ConfigError: this is no trained agent, or the name has another ending.
        """
        from rans.show.pages.playground import playground

        file = Path(file)
        if file.suffix != ".html":
            raise ConfigError(f"a page's name must end in .html, got {str(file)!r}.")
        playground(self.run, seed, episode).write(file)
        return file

    def export(self, output: str | Path, format: str = "rans", **options: Any) -> Path:
        """Export the agent for other software, and return the folder; options as for `rans.export`."""
        from rans.api.pages import export

        return export(self, output, format, **options)

    def report(self) -> Path:
        """Write the page report.html of its run folder, and return the file; see `rans.report`."""
        from rans.api.pages import report

        return report(self)

    def save(self, folder: str | Path) -> Path:
        """Copy the agent into a new folder, for `rans.load_agent` and every command, and return the folder.

        Raises:
            ConfigError: it has no run folder, as a controller, or the new one is not empty.
        """
        from rans.base.files import inside, ready_folder
        from rans.fast.learn.run_folder import RunFolder

        if self.folder is None:
            raise ConfigError(
                f"{self.name} cannot be saved: only trained agents have files of their own."
            )
        target = ready_folder(folder)
        if target.exists() and any(target.iterdir()):
            raise ConfigError(f"{target} is not empty: choose a new folder.")
        policy = RunFolder(self.folder).agent_file
        target.mkdir(parents=True, exist_ok=True)
        for name in (policy.name, *_COPIED):
            source = inside(self.folder, name)
            if source.is_file():
                shutil.copyfile(source, target / name)
        return target


@settled_alone
def load_agent(
    agent: object,
    task: str | Task | None = None,
    spacecraft: str | Path | Spacecraft | None = None,
    *,
    trust: bool = False,
) -> Agent:
    """Load an agent, a controller or a policy made elsewhere, with its spacecraft and its task.

    >>> rans.load_agent("go-to-pose-2d")
    <go-to-pose-2d: GoToPose for floating-platform>
    >>> rans.load_agent("lqr:go-to-position-3d")
    <LQR: GoToPosition for free-flyer>
    >>> def coast(observation):
    ...     return observation[:, :8] * 0
    >>> rans.load_agent(coast, "go-to-pose").evaluate(episodes=4)["solved"].value
    0.0

    Args:
        agent: a run folder, an exported folder, the name of an agent that comes with RANS, CONTROLLER:TASK-2d,
            sb3:FILE.zip:TASK-2d, onnx:FILE:TASK-2d or python:MODULE:FUNCTION:TASK-2d; or a policy: a
            Stable-Baselines3 model, a torch module, or a function of observations (N, width) that returns
            commands (N, thrusters).
        task: task of a policy that does not name one: a name or a `Task`; others refuse another than theirs.
        spacecraft: spacecraft of such a policy, or of an agent for any craft: a name, a TOML file or a
            `Spacecraft`; None: the floating platform, or the agent's own.
        trust: whether ``sb3:`` files may be opened, which are pickles, which can run code.

    Raises:
        ConfigError: there is no such agent, its files are damaged, a policy does not fit task and spacecraft, or
            the agent flies its own spacecraft only.
            Opening files runs no code, except with ``trust``.
    """
    from rans.episode.step import Setup
    from rans.evaluation.fly.agent import LoadedRun, load_policy, run_of
    from rans.evaluation.fly.any_craft import for_spacecraft
    from rans.evaluation.fly.contestant_name import ContestantName
    from rans.evaluation.fly.contestants import contestant
    from rans.evaluation.fly.object_policy import ObjectPolicy

    # The task that a policy or a name is flown on; agents of RANS have their own.
    setup = None
    if task is not None:
        craft = load_spacecraft(USUAL[2] if spacecraft is None else spacecraft)
        task_value = load_task(task)
        check_dimension(task_value, craft.dimension)
        setup = Setup(craft, task_value, task_value.timing)
    text = str(agent) if isinstance(agent, str | Path) else ""
    name = ContestantName.parse(text) if text else None
    if name and name.kind == "pretrained" and name.name in FOR_ANY_CRAFT.values():
        # Flights choose for this craft, and a task's own tolerances are those that it flies to.
        own = load_policy(name.own_folder)
        if setup is not None and type(setup.task) is type(own.task):
            own = own._replace(task=setup.task)
        run: LoadedRun | None = name.for_craft(
            own, craft=None if spacecraft is None else load_spacecraft(spacecraft)
        )
    else:
        run = contestant(text, default_setup=setup, trust=trust) if text else run_of(agent)
    if run is not None:
        if task is not None and type(load_task(task)) is not type(run.task):
            raise ConfigError(
                f"{run.controller.name} flies {type(run.task).__name__}, got the task {brief(task)}: leave "
                "the task out, or name an agent or a controller for it."
            )
        craft = run.craft if spacecraft is None else load_spacecraft(spacecraft)
        if craft != run.craft:
            return Agent(for_spacecraft(run, craft))
        return Agent(run, text if setup is None and spacecraft is None else "")
    # A policy made elsewhere, which needs a task.
    is_policy = callable(getattr(agent, "predict", None)) or callable(agent)
    if not is_policy or isinstance(agent, type):
        raise ConfigError(
            "an agent is its name, its run folder, a policy or what rans.load_agent gave, as in "
            f"rans.load_agent('lqr:go-to-pose-2d'), got {brief(agent)}."
        )
    if setup is None:
        raise ConfigError(
            f"{brief(agent)} is a policy that has no task: give one, as in "
            "rans.load_agent(policy, 'go-to-pose', 'floating-platform')."
        )
    policy = ObjectPolicy(agent, setup.craft, setup.task)
    return Agent(LoadedRun(policy, *setup[:4]))
