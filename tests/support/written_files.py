"""Files as commands write them, which tests then change, damage or replace."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import rans

TUNED = min((Path(rans.__file__).parent / "data" / "controllers").glob("lqr*.json"))
"""Settings of a controller as `rans tune` writes them."""

_ROW = {
    "contestant": "lqr",
    "solved": 1,
    "starts": 2,
    "flown": 1,
    "median_settling_time": 3.0,
    "mean_impulse": "inf",
}
_HELD = {"value": 1.0, "low": 0.0, "high": 1.0}
_LEVEL = {"size": None, "contestants": {"lqr": {"held": _HELD}}}
_CHECK = {"name": "n", "value": 1.0, "tolerance": 2.0, "unit": "m", "passed": True, "reason": "r"}
RESULTS: dict[str, Any] = {
    "compare.json": {"title": "t", "failures": ["f"], "notes": ["n"], "summary": [_ROW]},
    "stress.json": {"title": "t", "failures": ["f"], "conditions": {"lab": _LEVEL}},
    "validation.json": {
        "title": "t",
        "checks": [_CHECK],
        "skipped": [{"name": "n", "reason": "r"}],
    },
}
"""What `rans report` reads, by the names of files."""
