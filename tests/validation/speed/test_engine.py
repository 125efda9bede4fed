from __future__ import annotations

import pytest

from rans import GoToPose
from tests.support.engines import FLYER, PLATFORM
from validation.speed.engine import copy_bandwidth, engine_rate
from validation.speed.measurement import Clock


class Timed(Clock):
    """Every function takes half a second, after three to warm up."""

    def time(self, function: object) -> tuple[float, float]:
        return 0.5, 3.0


def test_a_copy_reads_and_writes():
    """An array of 128 MiB read and another written: 268 MB in half a second."""
    found = copy_bandwidth(Timed("cpu"))
    assert (found.value, found.unit, found.warm_up) == (
        pytest.approx(2 * 2**27 / 0.5 / 1e9),
        "GB/s",
        3.0,
    )


@pytest.mark.parametrize(
    ("craft", "moved"), [(PLATFORM, 135), (FLYER, 259)], ids=["plane", "space"]
)
def test_a_rate_counts_every_environment_of_every_step(craft, moved):
    """64 steps of 256 environments in half a second; the bound is bandwidth over docs/speed.md's bytes."""
    found = engine_rate(craft, GoToPose(), 256, Timed("cpu"), bandwidth=2.0, compiled=False)
    assert (found.value, found.unit) == (pytest.approx(64 * 256 / 0.5 / 1e6), "M steps/s")
    assert found.bound == pytest.approx(2e3 / moved)
    assert f"{moved} bytes a step must move; one episode in " in found.note
    assert found.note.endswith("not compiled")
    assert "256 environments" in found.name
    assert engine_rate(PLATFORM, GoToPose(), 2, Timed("cpu"), compiled=False).bound is None
