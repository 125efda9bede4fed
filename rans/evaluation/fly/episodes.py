"""Every single episode of an evaluation in one file, ``episodes.npz``, which `numpy.load` opens.

Keys, N episodes of T control periods:

- one array (N,) per metric, in its unit, named as in the tables with "_" for spaces: ``PT5``,
  ``reach_2_cm``, ``settling_time`` (infinite if never), ``position_error``, ...
- ``start`` and ``goal`` (N, k), and ``columns`` (k,), what each column is;
- with trajectories: ``times`` (T + 1,) s, ``states`` (T + 1, N, k) and ``commands`` (T, N, thrusters).
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from rans.evaluation.measure.metrics import samples
from rans.files import replace_file
from rans.flight import Flight
from rans.model.fields import leaves

_COLUMNS = {
    2: ("x", "y", "heading", "v_x", "v_y", "w_z"),
    3: ("x", "y", "z", "q_w", "q_x", "q_y", "q_z", "v_x", "v_y", "v_z", "w_x", "w_y", "w_z"),
}
"""Position in W (m), heading (rad) or attitude quaternion R_WB, velocity in W (m/s), spin in B (rad/s)."""


def save_episodes(flight: Flight, file: Path, trajectories: bool = False) -> None:
    """Write what was measured on every episode.

    Args:
        flight: N episodes.
        file: ends in ``.npz``; float32, compressed.
        trajectories: also write all states and commands.

    Raises:
        ConfigError: the disk refused.
    """
    arrays: dict[str, Any] = {s.name.replace(" ", "_"): s.values for s in samples(flight)}
    states = np.stack(leaves(flight.states), axis=-1)
    arrays |= {"start": states[0], "goal": np.stack(leaves(flight.goals), axis=-1)}
    if trajectories:
        arrays |= {"times": flight.times, "states": states, "commands": flight.commands}
    packed = {key: np.asarray(value, dtype=np.float32) for key, value in arrays.items()}
    save_arrays(file, packed | {"columns": np.array(_COLUMNS[flight.craft.dimension])})


def save_arrays(file: Path, arrays: dict[str, Any]) -> None:
    """Write arrays that `numpy.load` opens; `ConfigError` if the disk refused."""
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    replace_file(file, lambda draft: draft.write_bytes(content.getvalue()))
