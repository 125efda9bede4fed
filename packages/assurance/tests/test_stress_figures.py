"""Figures of a robustness sweep."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rans_assurance.figures import stress_figures
from rans_assurance.stress.run import Stress

from rans.show.palette import BLUE, ORANGE
from tests.support.stress_runs import FIRST, small


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def flown() -> Stress:
    stress = small(FIRST, "lqr", episodes=2)
    stress.fly(workers=1)
    return stress


@pytest.mark.slow
def test_figures_show_what_was_flown() -> None:
    """Shares at every size, the perfect world's first, everybody in a colour of his own."""
    stress = flown()
    (axes,) = stress_figures.effect_figure(stress, stress.effects[0]).axes
    lines = {
        line.get_label(): line for line in axes.lines if not str(line.get_label()).startswith("_")
    }
    assert [line.get_color() for line in lines.values()] == [BLUE, ORANGE]
    points = np.asarray(lines["LQR"].get_xydata())
    np.testing.assert_allclose(points, [(0.0, 100.0), (0.025, 100.0), (0.05, 100.0), (0.1, 100.0)])
    named, _ = stress_figures.named_figure(stress).axes
    assert [text.get_text() for text in named.get_yticklabels()] == ["perfect"]
