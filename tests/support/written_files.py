"""Files as commands write them, which tests then change, damage or replace."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import rans
from rans.evaluation.measure.aggregate import measure
from tests.support.evaluation_flights import two_episodes

TUNED = min((Path(rans.__file__).parent / "data" / "controllers").glob("lqr*.json"))
"""Settings of a controller as `rans tune` writes them."""
BOUND = {"failures": 17, "flights": 2000, "rate": 0.01, "at least": 0.004, "at most": 0.015}
SCOPE = {"sentence": "Requirement.", "rows": [["requirement", "position within 5 cm"]]}


def contents() -> dict[str, Any]:
    """Contents of a run folder's files as RANS writes them, with harmless texts."""
    summary = {"contestant": "agent", "starts": 1, "flown": 1, "solved": 1, "kind": "agent"}
    summary |= {"median_settling_time": 3.0, "mean_impulse": 1.5}
    check = {
        "name": "force",
        "value": 1e-16,
        "tolerance": 1e-12,
        "unit": "N",
        "reason": "Rounding.",
    }
    held = {"held": {"value": 0.5, "low": 0.1, "high": 0.9}}
    return {
        "config.json": {
            "seed": 3,
            "task": {"name": "go-to-pose"},
            "conditions": {"description": "a laboratory"},
            "about": {
                "command": "rans train",
                "environment": {"rans": "0.1", "gpu": {"name": "none"}},
            },
        },
        "validation.json": {
            "title": "Dynamics",
            "checks": [check | {"passed": True}],
            "skipped": [{"name": "kernel", "reason": "No compiler."}],
        },
        "evaluation.json": {
            "conditions": {"contestant": "agent"},
            "agent": measure(two_episodes()).to_json(),
        },
        "compare.json": {
            "hero": "A settles.",
            "tiles": [{"label": "solved", "value": "1 %", "note": "of 2"}],
            "title": "1 start",
            "failures": ["none came"],
            "summary": [summary],
        },
        "stress.json": {
            "title": "agent",
            "failures": [],
            "notes": ["a note"],
            "scope": SCOPE,
            "conditions": {
                "lab": {"size": None, "contestants": {"agent": held}},
                "latency-0.1": {"size": 0.1, "contestants": {"agent": {"held": {}}}},
            },
            "effects": {"latency": {"unit": "s", "holds_to": {"agent": 0.1}}},
        },
        "assurance-lab.json": {
            "about": {
                "agent": "agent",
                "confidence": 0.99,
                "below": None,
                "looks": [[2000, 0.01, 0.01]],
            },
            "scope": SCOPE,
            "decision": "open",
            "command": "rans assure agent",
            "bounds": {"any": BOUND, "LEFT": BOUND},
        },
    }
