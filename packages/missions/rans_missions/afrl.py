"""Networks of AFRL's safe-autonomy-sims as contestants: docking in `dock`, inspection in `inspect`.

Source of the observations, their norms and the clipping: repository act3-ace/safe-autonomy-sims, commit 6d71f7e
(March 2025). The networks are not part of RANS: the user fetches a file.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.effectors.commands import per_velocity
from rans.extend import ConfigError, Spacecraft, Task, Timing, read_bytes, require
from rans_missions.tasks import Dock
from rans_missions.tasks.inspect import Inspect
from rans_missions.vectors import components

NORMS = np.array([100.0, 100.0, 100.0, 0.5, 0.5, 0.5])
"""Divisors of position, m, and velocity, m/s. The count of points is divided by 100, and nothing else."""
SLOWEST, SLOPE, RADIUS = 0.2, 2.0, 0.5
"""The speed limit that they observe: 0.2 m/s + 2 n (distance - 0.5 m)."""
MOST = 1.0
"""Largest force along an axis of the Hill frame, N, to which outputs are clipped."""
POINTS = 100.0
"""Divisor of the number of points inspected."""
CLUSTER = 10
"""Points of a cluster, at most in the mean: there are as few clusters as that allows."""
_ITERATIONS = 50
"""Largest number of steps of Lloyd's algorithm, that of the source."""
_LARGEST = 2**24
"""Bytes of a network: theirs have 280,000."""
_OUTPUTS = 6


def docking(file: str | Path) -> type[AfrlDocking]:
    """Controller of a docking network, to be named in a module of your own and flown as MODULE:NAME.

    Args:
        file: docking.onnx or team-docking-0.onnx of safe-autonomy-sims.
    """

    class Network(AfrlDocking):
        path = Path(file)

    return Network


def inspection(
    file: str | Path, priority: tuple[float, float, float] = (0.0, 0.0, 1.0)
) -> type[AfrlInspection]:
    """Controller of an inspection network, to be named in a module of your own and flown as MODULE:NAME.

    Args:
        file: inspection.onnx, weighted-inspection.onnx or one of a team.
        priority: direction in W of the points with most weight, of a weighted network; others do not observe it.
    """

    class Network(AfrlInspection):
        path = Path(file)
        towards = np.array(priority, dtype=float) / np.linalg.norm(priority)

    return Network


class _Afrl(ABC):
    """Controller that asks a network once a control period for forces along the axes of W, which are held.

    Args:
        spacecraft: what flies: one throttled thruster either way along each axis.
        task: the mission, whose mean motion is that of the network's training.
        timing: control period.

    Raises:
        ConfigError: the task is another, the craft has other thrusters, or the file is no such network.
    """

    path: ClassVar[Path]
    mission: ClassVar[type]
    """The task that the network flies."""
    what: ClassVar[str]
    """What the network observes, of a refusal."""
    widths: ClassVar[tuple[int, ...]]
    """Numbers of an observation that networks of this kind take."""
    observes = False

    def __init__(self, spacecraft: Spacecraft, task: Task, timing: Timing) -> None:
        if not isinstance(task, self.mission):
            raise ConfigError(
                f"{self.what} of AFRL flies {self.mission.__name__}, got {type(task).__name__}: it observes what "
                "that mission has."
            )
        self.name = f"afrl:{self.path.name}"
        # Command of each thruster for 1 N along each axis.
        period = timing.control_period
        self._levers = np.array(per_velocity(spacecraft, period)) * period / spacecraft.mass
        self._network, self._width = _network(self.path, self.what, self.widths)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; reads position, velocity and what the goal notes."""
        p, v = (np.stack(np.broadcast_arrays(*x.columns()), axis=1) for x in (state.p, state.v))
        return np.clip(self._forces(self._observed(p, v, goal)) @ self._levers.T, 0.0, 1.0)

    @abstractmethod
    def _observed(self, p: np.ndarray, v: np.ndarray, goal: Any) -> np.ndarray:
        """Observation (N, width) at positions, m, and velocities, m/s, (N, 3)."""

    def _forces(self, observed: np.ndarray) -> np.ndarray:
        """Forces (N, 3), N."""
        # Means are every second output; the others are logarithms of deviations.
        return np.clip(self._network(observed.astype(np.float32))[:, ::2], -MOST, MOST)


class AfrlDocking(_Afrl):
    """Flies `Dock` by a docking network, which was trained for a period of 1 s, from 100 to 150 m away."""

    path = Path("docking.onnx")
    mission = Dock
    what = "a docking network"
    widths = (8,)

    def __init__(self, spacecraft: Spacecraft, task: Task, timing: Timing) -> None:
        super().__init__(spacecraft, task, timing)
        assert isinstance(task, Dock)
        self._n = task.mean_motion

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""

    def _observed(self, p: np.ndarray, v: np.ndarray, goal: Any) -> np.ndarray:
        distance = np.linalg.norm(p, axis=1, keepdims=True)
        speed = np.linalg.norm(v, axis=1, keepdims=True)
        limit = SLOWEST + SLOPE * self._n * (distance - RADIUS)
        return np.hstack([np.hstack([p, v]) / NORMS, speed, limit])

    def forces(self, p: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Forces (N, 3), N, at positions, m, and velocities, m/s, in the Hill frame, (N, 3)."""
        return self._forces(self._observed(p, v, None))


class AfrlInspection(_Afrl):
    """Flies `Inspect` by an inspection network, which was trained for a period of 10 s.

    It observes its motion, the number of points inspected, the direction of the nearest cluster of lit points that
    are not inspected, and the sun's angle, which the source counts from x towards -y. A weighted network observes
    in addition the direction of priority and the weight inspected.
    """

    path = Path("inspection.onnx")
    towards: ClassVar[np.ndarray] = np.array([0.0, 0.0, 1.0])
    mission = Inspect
    what = "an inspection network"
    widths = (11, 15)

    def __init__(self, spacecraft: Spacecraft, task: Task, timing: Timing) -> None:
        super().__init__(spacecraft, task, timing)
        assert isinstance(task, Inspect)
        self._task = task
        self._normals = np.array(task.normals)
        # The weight of a point is its angle from the direction opposite to that of priority.
        angles = np.arccos(np.clip(-self._normals @ self.towards, -1.0, 1.0))
        self._weights = angles / angles.sum()
        self.reset(0)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._centres: list[np.ndarray] = [np.zeros((0, 3))] * count

    def _observed(self, p: np.ndarray, v: np.ndarray, goal: Any) -> np.ndarray:
        """Observation (N, width) as the network's own simulation has it, of p and v (N, 3), m and m/s.

        Remembers the centres of clusters in `_centres`, which begin the next call.
        """
        count = len(p)
        inspected = np.stack(
            [np.broadcast_to(known, count) for _, known in self._task.markers(goal)], axis=1
        )
        sun = components(self._task.sun(goal), count)
        light = math.cos(math.radians(self._task.light_degrees))
        waiting = ~inspected & (sun @ self._normals.T > light)
        directions = np.zeros((count, 3))
        points = self._normals * self._task.surface_distance
        for row, of_row in enumerate(waiting):
            if of_row.any():
                self._centres[row] = clusters(points[of_row], self._centres[row])
                away = np.linalg.norm(self._centres[row] - p[row], axis=1)
                nearest = self._centres[row][int(np.argmin(away))]
                directions[row] = nearest / np.linalg.norm(nearest)
        seen = inspected.sum(axis=1, keepdims=True) / POINTS
        angle = np.arctan2(-sun[:, 1:2], sun[:, :1]) % (2.0 * math.pi)
        parts = [np.hstack([p, v]) / NORMS, seen, directions, angle]
        if self._width == max(self.widths):
            towards = np.broadcast_to(self.towards, (count, 3))
            parts += [towards, inspected @ self._weights[:, None]]
        return np.hstack(parts)


def clusters(points: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Centres of clusters of points by Lloyd's algorithm, from the centres of the previous call.

    Args:
        points: (P, 3) m, P > 0.
        before: centres of the previous call, (K, 3) m; the first ones are kept. K = 0: all begin at the origin.

    Returns:
        Centres, (P / `CLUSTER` rounded up, 3) m. A cluster that would have no point takes the one farthest from
        its centre, so that centres at the origin spread.
    """
    number = -(-len(points) // CLUSTER)
    if len(before):
        centres = np.vstack([before[:number], points[: max(0, number - len(before))]])
    else:
        centres = np.zeros((number, 3))
    for _ in range(_ITERATIONS):
        away = np.linalg.norm(points[:, None] - centres[None], axis=2)
        owner = away.argmin(axis=1)
        farthest = iter(np.argsort(-away.min(axis=1), kind="stable"))
        for empty in np.setdiff1d(np.arange(number), owner):
            owner[next(farthest)] = empty
        # A point that moved may have been the last one of its cluster, whose centre then stays.
        later = centres.copy()
        for k in np.unique(owner):
            later[k] = points[owner == k].mean(axis=0)
        if np.array_equal(later, centres):
            break
        centres = later
    return centres


def _network(file: Path, what: str, widths: tuple[int, ...]) -> tuple[Any, int]:
    """Function from observations (N, width) to outputs (N, 6), and the width."""
    onnxruntime = require("onnxruntime")
    if not file.is_file():
        raise ConfigError(
            f"there is no file {file}: copy {file.name} of act3-ace/safe-autonomy-sims there."
        )
    try:
        content = read_bytes(file, _LARGEST)
        session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors have no common class
        raise ConfigError(f"{file} is no ONNX network: {str(error)[:200]}") from error
    inputs = session.get_inputs()
    width = [list(x.shape)[-1] for x in inputs[:1]]
    given = [x.shape[-1] for x in session.get_outputs()[:1]]
    if len(inputs) != 2 or width not in [[x] for x in widths] or given != [_OUTPUTS]:
        raise ConfigError(
            f"{file} takes {len(inputs)} inputs, the first of {width} numbers, and gives {given}: {what} of AFRL "
            f"takes obs (N, {' or '.join(map(str, widths))}) and state_ins (N,), and gives {_OUTPUTS} numbers."
        )
    first, second = (x.name for x in inputs)

    def outputs(seen: np.ndarray) -> np.ndarray:
        ones = np.ones(len(seen), np.float32)
        return np.asarray(session.run(None, {first: seen, second: ones})[0], dtype=float)

    return outputs, width[0]
