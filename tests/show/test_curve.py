"""The learning curve by another process, or by this one where that fails."""

from __future__ import annotations

import sys

import pytest

from rans.show import curve as module
from rans.show.curve import curve, curve_in_another_process

ROWS = [
    {"steps": 100 * k, "seconds": 0.1 * k, "success": 0.2 * k, "return/pose": 3.0 * k}
    for k in range(1, 5)
]


@pytest.mark.slow
@pytest.mark.parametrize("dies", [False, True])
def test_another_process_draws_the_same(monkeypatch: pytest.MonkeyPatch, dies: bool) -> None:
    expected = curve(ROWS)
    monkeypatch.delitem(sys.modules, "matplotlib")
    if dies:
        monkeypatch.setattr(module, "_draw", print)
    with curve_in_another_process() as draw:
        found = draw(ROWS)
    # Matplotlib names what is clipped anew in every process.
    assert "environment steps (0.4 s in all)" in found
    assert len(found) == len(expected)
