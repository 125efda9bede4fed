"""Physical limits of a task: optimal trajectories, and bounds that no on/off controller can beat."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields
from numbers import Integral
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from rans.api.judging import CRAFT, SpacecraftLike
from rans.api.names import load_spacecraft, load_task
from rans.choices import ObjectiveName
from rans.errors import ConfigError, brief, is_finite, one_of, whole
from rans.model.dynamics import PlanarState, SpatialState, State
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.model.spacecraft import Spacecraft
from rans.scenario import EVALUATION_SEED, Endpoints, Scenario, scenarios
from rans.settled import settled_alone
from rans.tasks import Task

if TYPE_CHECKING:
    from rans.api.trajectory import CertifiedBound, OptimalTrajectory
    from rans.evaluation.compare.bounds import Kind

StateLike = int | State
"""A start: the number of a scenario, or a state as `state` makes it."""


def state(
    position: Sequence[float],
    attitude: float | Sequence[float] | None = None,
    velocity: Sequence[float] | None = None,
    spin: float | Sequence[float] | None = None,
) -> State:
    """Make a state to start from or to arrive at, in the plane or in space.

    >>> rans.state((3.0, -1.0), attitude=0.5).v
    Vec2(x=0.0, y=0.0)
    >>> rans.state((3.0, -1.0, 0.0)).attitude
    Quat(w=1.0, x=0.0, y=0.0, z=0.0)

    Args:
        position: p_WB, the position in the world frame W: two or three numbers, m.
        attitude: R_WB, of the body frame B in W: in the plane the heading, rad; in space a quaternion
            (w, x, y, z), which is normalized, or a Rotation of SciPy.
            None: aligned with the world.
        velocity: v_WB in W, m/s; None: at rest.
        spin: in the plane w_WB, rad/s; in space w_WB_B, three numbers. None: none.

    Raises:
        ConfigError: these are not so many finite numbers, or the quaternion is zero.
    """
    target = _numbers("position", position)
    if len(target) not in (2, 3):
        raise ConfigError(f"the position has 2 or 3 numbers, got {len(target)}.")
    size = len(target)
    moving = _numbers("velocity", [0.0] * size if velocity is None else velocity, size)
    if size == 2:
        heading = _numbers("attitude", [0.0 if attitude is None else attitude], 1)
        turning = _numbers("spin", [0.0 if spin is None else spin], 1)
        return PlanarState(Vec2(*target), Heading(heading[0]), Vec2(*moving), turning[0])
    if hasattr(attitude, "as_quat"):  # a Rotation of SciPy, whose real part comes last
        attitude = np.roll(attitude.as_quat(), 1)
    if is_finite(attitude):
        raise ConfigError(
            "a position with three numbers is in space, where the attitude is a quaternion (w, x, y, z), got "
            f"{brief(attitude)}."
        )
    quaternion = _numbers("attitude", (1.0, 0.0, 0.0, 0.0) if attitude is None else attitude, 4)
    length = float(np.linalg.norm(quaternion))
    if not length > 1e-6:
        raise ConfigError(f"the attitude is a quaternion (w, x, y, z), got {brief(attitude)}.")
    turning = _numbers("spin", [0.0] * 3 if spin is None else spin, 3)
    unit = Quat(*(x / length for x in quaternion))
    return SpatialState(Vec3(*target), unit, Vec3(*moving), Vec3(*turning))


def _numbers(what: str, values: Any, count: int | None = None) -> list[float]:
    """Finite numbers, ``count`` of them unless it is None; else a `ConfigError` that names what they are."""
    try:
        results = [float(x) for x in values]
    except (TypeError, ValueError) as error:
        raise ConfigError(f"the {what} must be numbers, got {brief(values)}.") from error
    if not np.isfinite(results).all() or (count is not None and len(results) != count):
        form = "finite numbers" if count is None else f"{count} finite numbers"
        raise ConfigError(f"the {what} must be {form}, got {brief(values)}.")
    return results


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
    zones: Sequence[Sequence[float]] = (),
    seed: int = EVALUATION_SEED,
    control_period: float = 0.2,
    intervals: int = 50,
    guesses: int | None = None,
    most_speed: float | None = None,
    most_spin: float | None = None,
) -> OptimalTrajectory:
    """Compute an optimal trajectory from one start, with thrust between 0 and 1, and fly it in Drake.

    >>> found = rans.optimal_trajectory("go-to-pose", objective="time", intervals=20)
    >>> found.status, round(found.trajectory.cost, 1)
    ('solved', 5.4)
    >>> own = rans.optimal_trajectory(start=rans.state((2.0, 1.0), attitude=1.0), horizon=10.0)
    >>> own.status, own.x[0, :3].round(6)
    ('solved', array([2., 1., 1.]))

    A start is the number of a scenario of the seed, or a state as `state` makes it; so is a goal. Of zones the
    coordinates of the centre in W come first, then the radius.

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
        zones: keep-out zones for the centre of mass, m.
        seed: random seed of the scenarios; the default has the starts that agents are evaluated on.
        control_period: time that a command is held, s; for "time" it is computed.
        intervals: number of control periods, for "time".
        guesses: number of initial guesses; the best solution counts, and ``trajectory.agreeing`` says how many
            led to it. None: 1; 3 for "time" in space, for tasks that leave the attitude free (in space 5) or with
            ``zones``.
        most_speed: largest speed of the trajectory, m/s.
        most_spin: largest angular speed of the trajectory, rad/s.

    Raises:
        ConfigError: one of these does not exist, or they do not go together.
    """
    from rans.api.trajectory import OptimalTrajectory
    from rans.evaluation.compare.optima import optima
    from rans.optimal.trajectory.limits import PathLimits
    from rans.optimal.trajectory.objectives import objective_of

    craft, judged = setup_of(task, spacecraft)
    objective_value = objective_of(objective, horizon, control_period, ending or "exact", intervals)
    scenario = _scenario(judged, craft, seed, start, goal)
    if isinstance(zones, str) or not isinstance(zones, Iterable):
        raise ConfigError(
            f"zones must be a list of zones, as in [(1.5, 0.0, 0.4)], got {brief(zones)}."
        )
    balls = tuple(tuple(_numbers("zone", zone)) for zone in zones)
    # The user's limits beside those of the task.
    limits = PathLimits(most_speed, most_spin, balls)
    limits = None if limits == PathLimits() else limits
    tried = None if guesses is None else whole("guesses", guesses)
    # Solve from several guesses, and fly the best in Drake.
    (optimum,) = optima(craft, judged, objective_value, scenario, tried, workers=1, limits=limits)
    number = _OWN if isinstance(start, State) else start
    return OptimalTrajectory(
        number,
        optimum.trajectory,
        optimum.replay_error,
        optimum.errors,
        optimum.flight,
        keep_out=balls,
    )


def setup_of(task: str | Task, spacecraft: SpacecraftLike | None) -> tuple[Spacecraft, Task]:
    """Spacecraft and task of optimal trajectories, with the starts of evaluations.

    Args:
        task: a name or a `Task`.
        spacecraft: a name, a TOML file or a `Spacecraft`; None: that of the task, or `CRAFT` if it has none.

    Raises:
        ConfigError: one of these does not exist.
    """
    judged = load_task(task).for_evaluation()
    return load_spacecraft(judged.spacecraft or CRAFT if spacecraft is None else spacecraft), judged


@settled_alone
def certify(
    task: str | Task = "go-to-pose",
    spacecraft: SpacecraftLike = CRAFT,
    *,
    kind: Kind = "arrival",
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
        spacecraft: a name, a TOML file or a `Spacecraft`.
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
    from rans.api.trajectory import CertifiedBound
    from rans.evaluation.compare.bounds import Event, Kind, certificates
    from rans.scenario import each

    one_of("kind", kind, get_args(Kind))
    judged = load_task(task).for_evaluation()
    craft = load_spacecraft(spacecraft)
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
    number = 0 if isinstance(start, State) else whole("start", start, least=0)
    sampled = scenarios(task, craft, seed, 1, first=number)
    return Endpoints(start if isinstance(start, State) else None, goal).applied(sampled)
