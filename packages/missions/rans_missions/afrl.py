"""Docking networks of AFRL's safe-autonomy-sims as contestants in `dock`.

Source of the observation, its norms and the clipping: repository act3-ace/safe-autonomy-sims, commit 6d71f7e (March
2025). The networks are not part of RANS: the user fetches a file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rans.effectors.commands import per_velocity
from rans.extend import ConfigError, Spacecraft, Task, Timing, read_bytes, require
from rans_missions.tasks import Dock

NORMS = np.array([100.0, 100.0, 100.0, 0.5, 0.5, 0.5, 1.0, 1.0])
"""Divisors of position, m, velocity, m/s, speed and speed limit."""
SLOWEST, SLOPE, RADIUS = 0.2, 2.0, 0.5
"""The speed limit that they observe: 0.2 m/s + 2 n (distance - 0.5 m)."""
MOST = 1.0
"""Largest force along an axis of the Hill frame, N, to which outputs are clipped."""
_LARGEST = 2**24
"""Bytes of a network: theirs have 280,000."""


def docking(file: str | Path) -> type[AfrlDocking]:
    """Controller of a docking network, to be named in a module of your own and flown as MODULE:NAME.

    Args:
        file: docking.onnx or team-docking-0.onnx of safe-autonomy-sims.
    """

    class Network(AfrlDocking):
        path = Path(file)

    return Network


class AfrlDocking:
    """Controller that asks a docking network once a control period, whose forces are held.

    The network was trained for a period of 1 s, from 100 to 150 m away, with attitude fixed in the Hill frame.

    Args:
        spacecraft: what flies: one throttled thruster either way along each axis.
        task: `Dock`, whose mean motion is in the speed limit.
        timing: control period.

    Raises:
        ConfigError: the task is another, the craft has other thrusters, or the file is no such network.
    """

    path = Path("docking.onnx")
    observes = False

    def __init__(self, spacecraft: Spacecraft, task: Task, timing: Timing) -> None:
        if not isinstance(task, Dock):
            raise ConfigError(
                f"a docking network of AFRL flies dock, got {type(task).__name__}: it observes the way to a target "
                "at the origin, and its speed limit."
            )
        self.name = f"afrl:{self.path.name}"
        self._n = task.mean_motion
        # Command of each thruster for 1 N along each axis.
        period = timing.control_period
        self._levers = np.array(per_velocity(spacecraft, period)) * period / spacecraft.mass
        self._network = _network(self.path)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; reads position and velocity."""
        p, v = (np.stack(np.broadcast_arrays(*x.columns()), axis=1) for x in (state.p, state.v))
        return np.clip(self.forces(p, v) @ self._levers.T, 0.0, 1.0)

    def forces(self, p: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Forces (N, 3), N, at positions, m, and velocities, m/s, in the Hill frame, (N, 3)."""
        distance = np.linalg.norm(p, axis=1, keepdims=True)
        speed = np.linalg.norm(v, axis=1, keepdims=True)
        limit = SLOWEST + SLOPE * self._n * (distance - RADIUS)
        seen = np.hstack([p, v, speed, limit]) / NORMS
        # Means are every second output; the others are logarithms of deviations.
        outputs = self._network(seen.astype(np.float32))[:, ::2]
        return np.clip(outputs, -MOST, MOST)


def _network(file: Path) -> Any:
    """Function from observations (N, 8) to outputs (N, 6)."""
    onnxruntime = require("onnxruntime")
    if not file.is_file():
        raise ConfigError(
            f"there is no file {file}: copy docking.onnx of act3-ace/safe-autonomy-sims there."
        )
    try:
        content = read_bytes(file, _LARGEST)
        session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors have no common class
        raise ConfigError(f"{file} is no ONNX network: {str(error)[:200]}") from error
    inputs = session.get_inputs()
    widths = (
        [list(x.shape)[-1] for x in inputs[:1]],
        [x.shape[-1] for x in session.get_outputs()[:1]],
    )
    if len(inputs) != 2 or widths != ([8], [6]):
        raise ConfigError(
            f"{file} takes {len(inputs)} inputs, the first of {widths[0]} numbers, and gives {widths[1]}: a "
            "docking network of AFRL takes obs (N, 8) and state_ins (N,), and gives 6 numbers."
        )
    first, second = (x.name for x in inputs)

    def outputs(seen: np.ndarray) -> np.ndarray:
        ones = np.ones(len(seen), np.float32)
        return np.asarray(session.run(None, {first: seen, second: ones})[0], dtype=float)

    return outputs
