from __future__ import annotations

import pytest

from validation.peers import stopwatch


def test_the_median_rate_after_warming_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """9 s to compile, 2 s to try; then three calls fill 6 s, in repeats of 3, 6, 12, 60 and 3 s.

    100 steps a call, and 4 s a call in the repeat of 12 s: the median call takes 2 s.
    """
    now = [0.0]
    calls = []
    took = iter(
        [9.0, 2.0, *(seconds for call in (1.0, 2.0, 4.0, 20.0, 1.0) for seconds in (call,) * 3)]
    )

    def call() -> None:
        now[0] += next(took)
        calls.append(1)

    monkeypatch.setattr(stopwatch.time, "perf_counter", lambda: now[0])
    assert stopwatch.steps_per_second(call, 100, 6.0) == pytest.approx(100 / 2.0)
    assert len(calls) == 2 + 5 * 3


def test_a_slow_call_is_counted_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(stopwatch.time, "perf_counter", lambda: now[0])

    def call() -> None:
        now[0] += 50.0

    assert stopwatch.steps_per_second(call, 100, 0.5) == pytest.approx(2.0)
