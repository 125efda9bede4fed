"""What is measured, on what, in which order: every figure's own test is where it is made."""

from __future__ import annotations

from typing import Any

import pytest

from rans.fast.learn.config import preset
from rans.tasks import GoToPose
from tests.support.engines import PLATFORM
from validation.speed import suite
from validation.speed.measurement import Measurement
from validation.speed.suite import effort, measurements
from validation.speed.training import LARGE


def test_a_gpu_has_torchs_compiler_and_a_large_training_beside_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is asked for beside what a CPU is asked for; agents answer on a CPU all the same."""
    found = Measurement("engine", "x", 12.0, "GB/s")
    asked: list[tuple[str, Any]] = []
    one = ("copy_bandwidth", "engine_rate", "memory_per_environment", "trainer_rate")
    for name in (*one, "flight_rates", "solver_rate", "latencies"):
        answer: Any = found if name in one else [found]
        monkeypatch.setattr(
            suite,
            name,
            lambda *told, a=answer, n=name, **more: asked.append((n, (told, more))) or a,
        )

    def told(name: str) -> list[Any]:
        return [what for asked_for, what in asked if asked_for == name]

    list(measurements([PLATFORM], "go-to-pose", GoToPose(), (16,), effort("cuda", quick=True)))
    assert [more for _, more in told("engine_rate")] == [{}, {"generated": False}]
    presets = [preset("go-to-pose", 2, device) for device in ("cuda", "cpu")]
    assert [given[2] for given, _ in told("trainer_rate")] == [presets[0], LARGE]
    assert [given[2] for given, _ in told("latencies")] == [presets[1]]
