from __future__ import annotations

import pytest

from rans.tasks import GoToPose
from tests.fast.engines import PLATFORM
from validation.speed.engine import engine_rate
from validation.speed.measurement import Clock


@pytest.mark.slow  # compiles
@pytest.mark.filterwarnings("ignore:.*torch.jit.script_method:DeprecationWarning")  # torch's own
def test_compiling_is_warm_up() -> None:
    clock = Clock("cpu", repeats=2, seconds=0.01)
    m = engine_rate(PLATFORM, GoToPose(), 64, clock, bandwidth=27.0)
    assert m.value is not None
    assert m.bound == pytest.approx(1e3 * 27.0 / 135)  # 27 GB/s, 135 bytes a step
    assert m.warm_up > 100 * 64 / (1e6 * m.value)  # one step of 64 takes microseconds, compiling it seconds
    assert "not compiled" not in m.note
