import pytest

from validation.speed.measurement import Clock


def test_warm_up_is_apart(monkeypatch):
    """A clock that the function itself moves: 5 s of compiling once, 2 s a call."""
    now = [0.0]
    calls = []

    def work():
        now[0] += 2.0 if calls else 7.0
        calls.append(1)

    monkeypatch.setattr("validation.speed.measurement.time.perf_counter", lambda: now[0])
    seconds, warm_up = Clock("cpu", repeats=3, seconds=10.0).time(work)
    assert seconds == 2.0
    assert warm_up == pytest.approx(7.0 + 3 * 2.0)
    assert len(calls) == 4 + 1 + 3 * 5


def test_a_clock_tells_the_median(monkeypatch):
    """Repeats of 1, 5 and 3 s a call: 3 s; warm-up and the choice of calls come before."""
    took = iter([0.5, 1.0, 1.0, 5.0, 3.0])
    monkeypatch.setattr(Clock, "_took", lambda *_: next(took))
    assert Clock("cpu", repeats=3, seconds=1.0).time(lambda: None) == (3.0, 2.0)
