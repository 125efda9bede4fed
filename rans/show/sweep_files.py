"""Files of a sweep beside its checkpoints: results, and the run folder of its best agent."""

from __future__ import annotations

import json
from pathlib import Path

from rans.fast.learn.sweep import Sweep
from rans.files import environment, plain, write_json, write_text


def save_sweep(sweep: Sweep, folder: Path) -> None:
    """Write sweep.json, metrics.jsonl and best/.

    Raises:
        ConfigError: the disk refused.
    """
    best = sweep.best()
    rows = [
        {"member": number} | row
        for number, member in enumerate(sweep.members)
        for row in member.rows
    ]
    write_text(folder / "metrics.jsonl", "".join(json.dumps(plain(row)) + "\n" for row in rows))
    write_json(
        folder / "sweep.json",
        {
            "command": sweep.command,
            "environment": environment(),
            "seconds": sweep.seconds,
            "best": sweep.members.index(best),
            "members": sweep.results(),
        },
    )
    sweep.save_best()
