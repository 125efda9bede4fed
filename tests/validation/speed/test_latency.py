import numpy as np
import pytest

from validation.speed import latency


def test_median_and_99th_percentile_in_microseconds(monkeypatch):
    """Ten calls of 7 ms to warm up, then a hundred of 1 to 100 ms."""
    took = [7e-3] * 10 + [k * 1e-3 for k in range(100, 0, -1)]
    readings = iter([reading for seconds in took for reading in (50.0, 50.0 + seconds)])
    monkeypatch.setattr(latency.time, "perf_counter", lambda: next(readings))
    median, tail = latency._measured("NumPy, x", lambda x: x, np.zeros(1), 100)
    assert (median.name, median.value, median.unit) == (
        "NumPy, x, median",
        pytest.approx(50_500.0),
        "us",
    )
    assert (tail.name, tail.value) == ("NumPy, x, 99th percentile", pytest.approx(99_010.0))
    assert (median.warm_up, median.note) == (pytest.approx(0.07), "of 100 calls")
