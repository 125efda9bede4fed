"""What the commands do, as functions: each takes names, files or objects, and returns what it found.

They are at the top of the package (``rans.evaluate``) and load what they need when they are called.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from rans.errors import ConfigError, brief, checked, one_of, whole
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft, to_toml
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import load_conditions
from rans.scenario import EVALUATION_SEED, scenarios
from rans.tasks import Task, load_task, registered_name

if TYPE_CHECKING:
    from rans.evaluation.compare.bounds import Bound, Kind
    from rans.evaluation.compare.entrants import Guest
    from rans.evaluation.compare.optima import Optimum
    from rans.evaluation.compare.run import Comparison
    from rans.evaluation.fly.agent import LoadedRun
    from rans.evaluation.fly.episodes import EngineName
    from rans.evaluation.fly.lookahead import Lookahead
    from rans.evaluation.fly.protocols import ProtocolName
    from rans.evaluation.measure.aggregate import Metrics
    from rans.fast.learn.config import Algorithm, PPOSettings, TrainConfig
    from rans.optimal.trajectory.objectives import ObjectiveName
    from validation.study.checks import Study

SpacecraftLike = str | Path | Spacecraft
"""By name, TOML file or as such."""
ConditionsLike = str | Path | Conditions
"""The same of conditions."""
_CRAFT = "floating-platform"


def load_agent(name: str | Path) -> LoadedRun:
    """An agent or a controller, with the spacecraft and task that it is for.

    >>> rans.load_agent("go-to-pose-2d")
    <go-to-pose-2d: GoToPose for floating-platform>
    >>> rans.load_agent("lqr:go-to-position-3d")
    <LQR: GoToPosition for free-flyer>

    Args:
        name: a run folder, the name of an agent that comes with RANS, or CONTROLLER:TASK-2d; see
            `rans.evaluation.fly.contestants.contestant`.

    Raises:
        ConfigError: there is none, or its files are damaged. Opening them runs nothing that is in them.
    """
    from rans.evaluation.fly.contestants import contestant, text_of

    return contestant(text_of(name))


def evaluate(
    agent: str | Path | LoadedRun | Lookahead,
    *,
    episodes: int = 1024,
    seed: int = EVALUATION_SEED,
    engine: EngineName = "fast",
    conditions: ConditionsLike | None = None,
    protocol: ProtocolName = "own",
) -> Metrics:
    """Fly from fixed starts: metrics with 95 % intervals, as `rans evaluate` prints.

    >>> found = rans.evaluate("go-to-pose-2d", episodes=16)
    >>> found["solved"].value, found["solved"].unit
    (100.0, '%')

    Args:
        agent: who flies, see `load_agent`; or a `Lookahead`.
        episodes: number of flights.
        seed: of starts and goals.
        engine: "fast", or "drake" as an independent judge.
        conditions: what episodes do not promise, by name, TOML file or as such; None: those of the training.
        protocol: "own", "paper" or "original", see `rans.evaluation.fly.protocols.under_protocol`.

    Raises:
        ConfigError: one of these does not exist, or the agent knows several tasks and none is picked, as in
            NAME#TASK.
    """
    from rans.evaluation.fly.contestants import in_protocol
    from rans.evaluation.fly.episodes import EngineName, fly_episodes
    from rans.evaluation.measure.aggregate import measure

    one_of("engine", engine, get_args(EngineName))
    run = in_protocol(agent, protocol)
    if first := next(iter(run.task.parts())):
        raise ConfigError(
            f"{run.controller.name} knows several tasks: pick one, as in "
            f"{run.controller.name}#{first}."
        )
    setup = run.under(conditions).judged
    count = whole("episodes", episodes)
    flight, _ = fly_episodes(run.controller, setup, seed, count, engine)
    return measure(flight)


def compare(
    *contestants: str | Path | Guest,
    beside: str | Sequence[str] = ("lqr", "switching", "mpc", "optimal"),
    episodes: int = 128,
    certified: int = 4,
    seed: int = EVALUATION_SEED,
    engine: EngineName = "fast",
    conditions: ConditionsLike | None = None,
    trust: bool = False,
    workers: int | None = None,
) -> Comparison:
    """Fly agents, policies and simple controllers from the same starts, beside what is possible.

    >>> found = rans.compare("go-to-pose-2d", beside=["lqr"], episodes=4)
    >>> [entry.name for entry in found.entries]
    ['go-to-pose-2d', 'LQR']

    Args:
        *contestants: as of `rans compare`; the first gives task, spacecraft and rate. Others may also be
            controllers made for these (`Controller`), or what makes one of them, such as a class.
        beside: controllers that join them, unless one of that name is there, and "optimal", the best that
            is possible; a name, or several.
        episodes: number of starts.
        certified: starts whose bounds are certified, about 25 processor seconds each.
        seed: of the starts.
        engine: see `evaluate`.
        conditions: see `evaluate`.
        trust: whether ``sb3:`` files may be pickles of strangers, which run the code in them.
        workers: processes; None: one per processor.

    Raises:
        ConfigError: a contestant does not exist, or is not for the same task, spacecraft and rate.
    """
    from rans.evaluation.compare.entrants import contest_of, enlisted, invitations
    from rans.evaluation.compare.run import Comparison
    from rans.evaluation.fly.controllers import CONTROLLERS
    from rans.evaluation.fly.episodes import EngineName

    first, invited = invitations(contestants)
    one_of("engine", engine, get_args(EngineName))
    beside = (beside,) if isinstance(beside, str) else beside
    if not isinstance(beside, Sequence) or not all(isinstance(name, str) for name in beside):
        raise ConfigError(f'beside takes names of controllers and "optimal", got {brief(beside)}.')
    for name in {*beside} - {"optimal"}:
        CONTROLLERS[name]  # a wrong name is told before anybody flies
    whole("certified", certified, least=0)
    contest = contest_of(first, whole("episodes", episodes), seed, engine, conditions)
    found = Comparison(contest)
    found.fly(enlisted(invited, contest, trust), beside, certified, workers=workers)
    return found


def optimal_trajectory(
    task: str | Task = "go-to-pose",
    spacecraft: SpacecraftLike = _CRAFT,
    *,
    objective: ObjectiveName = "fuel",
    start: int = 0,
    seed: int = EVALUATION_SEED,
    horizon: float | None = None,
    ending: Literal["exact", "set"] = "exact",
    control_period: float = 0.2,
    intervals: int = 50,
    guesses: int = 1,
) -> Optimum:
    """The best trajectory from one start, with thrust between 0 and 1, flown in Drake.

    >>> found = rans.optimal_trajectory("go-to-pose", objective="time", intervals=20)
    >>> found.sentence, round(found.trajectory.cost, 1)
    ('solved', 5.4)

    Args:
        task: what to do, by name or with settings.
        spacecraft: what flies, by name, TOML file or as such.
        objective: see `rans.optimal.trajectory.objectives.objective_of`, as the others that are not here.
        start: number of the scenario of the seed.
        seed: 2023 has the starts that agents are judged on.
        horizon: s; None: what is usual for the objective.
        ending: exactly, or within the task's tolerances.
        control_period: s.
        intervals: control periods of a least time.
        guesses: motions to start the optimiser from; the best outcome counts.

    Raises:
        ConfigError: one of these does not exist, or they do not go together.
    """
    from rans.evaluation.compare.optima import optima
    from rans.optimal.trajectory.objectives import objective_of

    judged = load_task(task).for_evaluation()
    craft = load_spacecraft(spacecraft)
    wanted = objective_of(objective, horizon, control_period, ending, intervals)
    one = scenarios(judged, craft, seed, 1, first=whole("start", start, least=0))
    (found,) = optima(craft, judged, wanted, one, whole("guesses", guesses), workers=1)
    return replace(found, start=start)


def certify(
    task: str | Task = "go-to-pose",
    spacecraft: SpacecraftLike = _CRAFT,
    *,
    kind: Kind = "arrival",
    horizon: float | None = None,
    start: int = 0,
    seed: int = EVALUATION_SEED,
    control_period: float = 0.2,
    seconds: float = 20.0,
) -> Bound:
    """What no on/off controller can beat from one start: a proof, and the best that was found.

    >>> found = rans.certify("go-to-pose", start=3, control_period=0.5)
    >>> found.lower, found.upper  # s: nothing is faster than 5.5, and something is as fast
    (5.5, 5.5)

    Args:
        task: what to do, by name or with settings.
        spacecraft: what flies, by name, TOML file or as such.
        kind: "arrival" at rest, or "settling" within the tolerances for good.
        horizon: s: bounds the thrust-time (N s) of being there by then; None: bounds the time (s).
        start: number of the scenario of the seed.
        seed: 2023 has the starts that agents are judged on.
        control_period: for which commands are held, s.
        seconds: for the search; less gives a wider gap between both bounds, and changes no bound's truth.

    Raises:
        ConfigError: one of these does not exist, or no bound is known of such an event.
    """
    from rans.evaluation.compare.bounds import Event, Kind, bound, question
    from rans.optimal.certificate.certificate import Effort
    from rans.scenario import each

    one_of("kind", kind, get_args(Kind))
    judged = load_task(task).for_evaluation()
    craft = load_spacecraft(spacecraft)
    (one,) = each(scenarios(judged, craft, seed, 1, first=whole("start", start, least=0)))
    return bound(
        start, question(craft, judged, control_period, Event(kind, horizon), Effort(seconds), one)
    )


def validate(
    spacecraft: SpacecraftLike = _CRAFT,
    *,
    quick: bool = False,
    layer: str | None = None,
    conditions: ConditionsLike | None = None,
    seed: int = 0,
) -> Study:
    """Check a spacecraft's motion against Drake and the laws of mechanics, layer by layer.

    >>> found = rans.validate("floating-platform", quick=True, layer="thrusters")
    >>> found.passed, len(found.checks)
    (True, 2)

    Args:
        spacecraft: what flies, by name, TOML file or as such.
        quick: fewer states and flights and no compiler: some seconds instead of some minutes.
        layer: the only one to look at: thrusters, commands, accelerations, period, flights, engine, ...
        conditions: to fly under too, each effect alone and all together.
        seed: of the random states and commands.

    Raises:
        ConfigError: Drake refuses the mass properties, or one of these does not exist.
    """
    from rans.cli import laboratory

    laboratory.enter()
    from validation.study.study import study

    met = None if conditions is None else load_conditions(conditions)
    return study(load_spacecraft(spacecraft), seed, quick, layer, conditions=met)


def train(
    task: str | Task = "go-to-pose",
    spacecraft: SpacecraftLike | None = None,
    *,
    seed: int = 0,
    device: str | None = None,
    total_timesteps: int | None = None,
    conditions: ConditionsLike | None = None,
    ppo: PPOSettings | None = None,
    algorithm: Algorithm | None = None,
    plain: bool = False,
    run: str | Path | None = None,
    report: Callable[[dict[str, Any]], object] | None = None,
) -> LoadedRun:
    """Train an agent until it has solved its task, as `rans train`; on a CPU with one of torch's threads.

    >>> folder = tempfile.mkdtemp()
    >>> rans.train("go-to-pose", "floating-platform-shared", total_timesteps=8192, run=f"{folder}/mine")
    <mine: GoToPose for floating-platform-shared>

    Args:
        task: by name or with settings, or the name of an agent that comes with RANS, to train it as it was, or
            the TOML file of a recipe.
        spacecraft: what flies, by name, TOML file or as such; None: the floating platform, or the agent's.
        seed: of starts, goals, weights and actions.
        device: "cpu" or "cuda"; None: a GPU if there is one.
        total_timesteps: environment steps after which training ends, solved or not; None: as usual.
        conditions: what episodes do not promise; None: a perfect world, or the agent's.
        ppo: settings of the training; None: those known to work.
        algorithm: "ppo", or "gradient": down the gradient of the return through the motion, for throttled
            thrusters (docs/training.md); None: PPO, or the agent's.
        plain: whether everything is computed as it is written, so that a breakpoint in a task stops.
        run: a new folder for what it leaves; None: one under runs/.
        report: called with every row of metrics, such as ``print``.

    Raises:
        ConfigError: one of these does not exist, or they do not go together.
        NonFiniteState: a value became NaN or infinite.
    """
    from rans.evaluation.fly.agent import load_agent as trained
    from rans.fast.learn.run_folder import RunFolder, run_path
    from rans.fast.learn.trainer import Trainer

    config = _config(
        task,
        spacecraft,
        device,
        ppo,
        conditions,
        algorithm,
        seed=seed,
        total_timesteps=total_timesteps,
    )
    config = replace(config, plain=plain or config.plain)
    craft = load_spacecraft(config.spacecraft if spacecraft is None else spacecraft)
    folder = Path(run) if run is not None else run_path(config)
    if isinstance(spacecraft, Spacecraft):
        config = replace(config, spacecraft=str(folder / "spacecraft.toml"))
    kept = RunFolder(folder)
    trainer = Trainer([config], craft, kept)
    kept.begin(config, "rans.train", to_toml(craft) if isinstance(spacecraft, Spacecraft) else "")
    trainer.train(lambda members: report(members[0].rows[-1]) if report else None)
    return trained(folder)


def _config(
    task: str | Task,
    spacecraft: SpacecraftLike | None,
    device: str | None,
    ppo: PPOSettings | None,
    conditions: ConditionsLike | None,
    algorithm: Algorithm | None,
    **numbers: int | None,
) -> TrainConfig:
    """The training of a name, with what was given in the place of what it has."""
    from rans.fast.learn.recipes import by_gradient, training

    craft = None if spacecraft is None else load_spacecraft(spacecraft)
    named = str(spacecraft) if isinstance(spacecraft, str | Path) else _CRAFT
    config = training(_name(task), named, device)
    if algorithm == "gradient":
        config = by_gradient(config)
    given: dict[str, Any] = {
        **numbers,
        "algorithm": algorithm,
        "spacecraft": None if craft is None else named,
        "settings": task if isinstance(task, Task) else None,
        "ppo": None if ppo is None else checked("ppo", ppo, type(config.ppo)),
        "conditions": None if conditions is None else load_conditions(conditions),
    }
    return replace(config, **{key: value for key, value in given.items() if value is not None})


def _name(task: str | Task) -> str:
    """The name of a task's class, or of a recipe; `ConfigError` where it is neither a name nor a task."""
    if isinstance(task, str):
        return task
    task = load_task(task)
    kind = type(task)
    return registered_name(task) or f"{kind.__module__}:{kind.__qualname__}"
