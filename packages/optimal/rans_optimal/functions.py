"""Physical limits of a task: optimal trajectories, and bounds that no on/off controller can beat."""

from __future__ import annotations

from dataclasses import fields
from numbers import Integral
from typing import TYPE_CHECKING, Any, Literal, get_args

from rans import TASKS, load_spacecraft, scenarios
from rans.api.states import WrittenEndpoints
from rans.extend import (
    EVALUATION_SEED,
    ConfigError,
    Event,
    Scenario,
    Spacecraft,
    SpacecraftLike,
    State,
    Task,
    brief,
    certificates,
    each,
    one_of,
    settled_alone,
    typed,
    whole,
)
from rans_optimal.checks import ObjectiveName

if TYPE_CHECKING:
    from rans_optimal.history import CertifiedBound, OptimalTrajectory

_CRAFT = "floating-platform"
"""Spacecraft where none is named."""
_Kind = Literal["arrival", "settling"]
StateLike = int | State
"""A start: the number of a scenario, or a state as `state` makes it."""


@settled_alone
def optimal_trajectory(
    task: str | Task = "go-to-pose",
    spacecraft: SpacecraftLike | None = None,
    *,
    objective: ObjectiveName = "fuel",
    ending: Literal["exact", "set"] | None = None,
    horizon: float | None = None,
    start: StateLike = 0,
    goal: State | None = None,
    seed: int = EVALUATION_SEED,
    control_period: float = 0.2,
    intervals: int = 50,
    guesses: int | None = None,
) -> OptimalTrajectory:
    """Compute an optimal trajectory from one start, with thrust between 0 and 1, and fly it in Drake.

    >>> found = rans.optimal_trajectory("go-to-pose", objective="time", intervals=20)
    >>> found.status, round(found.trajectory.cost, 1)
    ('solved', 5.4)
    >>> own = rans.optimal_trajectory(start=rans.state((2.0, 1.0), attitude=1.0), horizon=10.0)
    >>> own.status, own.x[0, :3].round(6)
    ('solved', array([2., 1., 1.]))

    A start is the number of a scenario of the seed, or a state as `state` makes it; so is a goal.

    Args:
        task: task, see `rans list TASKS`.
        spacecraft: name of a spacecraft that comes with RANS, or your own TOML file; by default that of the task,
            or floating-platform.
        objective: what is minimized: impulse (fuel), time, squared thrust (energy), or minus
            the task's return (reward).
        ending: arrive exactly, or within the task's tolerances (set); for fuel, time and energy. By default exact,
            for land set, which is what its success asks for.
        horizon: length of the trajectory, s: by default 20, for reward 25. For time it is computed. For a mission
            on an orbit it is the deadline, by default the latest.
        start: your own start in place of a sampled one.
        goal: see `rans.api.judging.evaluate`.
        seed: random seed of the scenarios; the default has the starts that agents are evaluated on.
        control_period: time that a command is held, s; for "time" it is computed.
        intervals: number of control periods, for "time".
        guesses: number of initial guesses; the best solution counts, and ``trajectory.agreeing`` says how many
            led to it. None: 1; 3 for "time" in space, for tasks that leave the attitude free (in space 5).

    Raises:
        ConfigError: one of these does not exist, or they do not go together.
    """
    from rans_optimal.history import OptimalTrajectory
    from rans_optimal.objectives import objective_of
    from rans_optimal.optima import optima

    craft, judged = setup_of(task, spacecraft)
    objective_value = objective_of(objective, horizon, control_period, ending or "exact", intervals)
    scenario = _scenario(judged, craft, seed, start, goal)
    tried = None if guesses is None else whole("guesses", guesses)
    # Solve from several guesses, and fly the best in Drake.
    (optimum,) = optima(craft, judged, objective_value, scenario, tried, workers=1)
    number = _OWN if isinstance(start, State) else start
    return OptimalTrajectory(
        number,
        optimum.trajectory,
        optimum.replay_error,
        optimum.errors,
        optimum.flight,
    )


def setup_of(task: str | Task, spacecraft: SpacecraftLike | None) -> tuple[Spacecraft, Task]:
    """Spacecraft and task of optimal trajectories, with the starts of evaluations.

    Args:
        task: a name or a `Task`.
        spacecraft: a name, a TOML file or a `Spacecraft`; None: that of the task, or `_CRAFT` if it has none.

    Raises:
        ConfigError: one of these does not exist.
    """
    asked = task if isinstance(task, Task) else TASKS[typed(task)]()
    judged = asked.for_evaluation()
    craft = load_spacecraft(judged.spacecraft or _CRAFT if spacecraft is None else spacecraft)
    return craft, judged


@settled_alone
def certify(
    task: str | Task = "go-to-pose",
    spacecraft: SpacecraftLike | None = None,
    *,
    kind: _Kind = "arrival",
    horizon: float | None = None,
    start: StateLike = 0,
    goal: State | None = None,
    seed: int = EVALUATION_SEED,
    control_period: float = 0.2,
    seconds: float = 20.0,
) -> CertifiedBound:
    """Bound what any on/off controller can reach from one start, and find commands that come close.

    >>> found = rans.certify("go-to-pose", start=3, control_period=0.5)
    >>> found.lower, found.upper  # s: nothing is faster than 5.5, and something is as fast
    (5.5, 5.5)

    Args:
        task: a name or a `Task`.
        spacecraft: a name, a TOML file or a `Spacecraft`; by default that of the task, or floating-platform.
        kind: "arrival" at rest, or "settling" within the tolerances for good.
        horizon: time, s, by which the event must have happened: bounds the impulse (N s). None: bounds the
            time (s).
        start: number of a scenario of the seed, or a state as `state` makes it.
        goal: state to arrive at; None: the scenario's.
        seed: random seed of the scenarios; the default has the starts that agents are evaluated on.
        control_period: time that a command is held, s.
        seconds: work of the search, by what a core at 3 GHz does in a second, so that every machine answers
            the same; less gives a wider gap between the bounds, which hold in any case.

    Raises:
        ConfigError: one of these does not exist, or no bound is known for this task and spacecraft.
    """
    from rans_optimal.history import CertifiedBound

    one_of("kind", kind, get_args(_Kind))
    craft, judged = setup_of(task, spacecraft)
    scenario = _scenario(judged, craft, seed, start, goal)
    (single,) = each(scenario)
    event = Event(kind, horizon)
    number = _OWN if isinstance(start, State) else start
    # The certified bound of this event alone.
    result = certificates().bound(number, craft, judged, control_period, event, seconds, single)
    values = {key.name: getattr(result, key.name) for key in fields(result)}
    return CertifiedBound(
        **values, craft=craft, task=judged, scenario=scenario, control_period=control_period
    )


_OWN = -1
"""Number of a start that is no scenario of a seed."""


def _scenario(
    task: Task, craft: Spacecraft, seed: int, start: StateLike, goal: State | None
) -> Scenario:
    """One start and goal as a batch, fields (1,).

    Raises:
        ConfigError: a state is none, or of another dimension than the craft.
    """
    if not isinstance(start, State | Integral):
        raise ConfigError(
            "start must be the number of a scenario, or a state such as rans.state((2.0, 1.0), attitude=1.0), got "
            f"{brief(start)}."
        )
    if isinstance(start, State):
        return starts_of(task, craft, seed, 0, 1, start, goal)
    return starts_of(task, craft, seed, whole("start", start, least=0), 1, None, goal)


def starts_of(
    task: Task, craft: Spacecraft, seed: int, first: int, count: int, start: Any, goal: Any
) -> Scenario:
    """Scenarios of a seed, or those of a user's own start and goal, each a state, words or None.

    Raises:
        ConfigError: a state is of another dimension than the craft, or words are none.
    """
    sampled = scenarios(task, craft, seed, count, first=first)
    return WrittenEndpoints(start, goal).applied(sampled)
