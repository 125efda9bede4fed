"""What is measured, on what, in which order: every figure's own test is where it is made."""

from __future__ import annotations

from typing import Any

import pytest

from rans.fast.learn.recipes import preset
from rans.tasks import GoToPose
from tests.support.engines import PLATFORM
from validation.speed import suite
from validation.speed.measurement import Measurement
from validation.speed.suite import effort, measurements
from validation.speed.training import LARGE


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What every function is called with."""
    calls: list[tuple[Any, ...]] = []

    def stand_in(name: str, several: bool = False) -> Any:
        def measure(*arguments: Any, **more: Any) -> Any:
            calls.append(
                (
                    name,
                    *(getattr(x, "name", x) for x in arguments if not isinstance(x, GoToPose)),
                    *more.items(),
                )
            )
            found = Measurement("engine", name, 12.0, "GB/s")
            return [found] if several else found

        return measure

    for name in ("copy_bandwidth", "engine_rate", "memory_per_environment", "trainer_rate"):
        monkeypatch.setattr(suite, name, stand_in(name))
    for name in ("flight_rates", "solver_rate", "latencies"):
        monkeypatch.setattr(suite, name, stand_in(name, several=True))
    return calls


def test_a_gpu_has_torchs_compiler_and_a_large_training_beside_it(
    asked: list[tuple[Any, ...]],
) -> None:
    """Agents answer on a CPU all the same."""
    spend = effort("cuda", quick=True)
    list(measurements([PLATFORM], "go-to-pose", GoToPose(), (16,), spend))
    clock = spend.clock
    name = "floating-platform"
    assert asked == [
        ("copy_bandwidth", clock),
        ("engine_rate", name, 16, clock, 12.0, None),
        ("engine_rate", name, 16, clock, 12.0, ("generated", False)),
        ("memory_per_environment", name, 16, clock),
        ("flight_rates", name, 2**22, clock),
        ("trainer_rate", name, preset("go-to-pose", 2, "cuda"), clock),
        ("trainer_rate", name, LARGE, clock),
        ("solver_rate", name, 1),
        ("latencies", name, preset("go-to-pose", 2, "cpu"), 50),
    ]
