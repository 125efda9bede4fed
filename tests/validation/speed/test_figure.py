from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex

from rans.show.palette import BLUE, RED
from validation.speed.figure import speed_figure
from validation.speed.measurement import Measurement

MEASURED = [
    Measurement("engine", "small", 30.0, "M steps/s", bound=80.0),
    Measurement("engine", "large", 2500.0, "M steps/s"),
    Measurement("policy", "torch", 74.0, "us"),
    Measurement("policy", "ONNX", None, "us"),
    Measurement("memory", "copy", 20.0, "GB/s"),
]


def bars(axes: Any) -> list[tuple[str, float, float, str]]:
    """Name, start and end of every bar, and its colour."""
    names = [label.get_text() for label in axes.get_yticklabels()]
    return [
        (name, bar.get_x(), bar.get_x() + bar.get_width(), to_hex(bar.get_facecolor()))
        for name, bar in zip(names, axes.patches, strict=True)
    ]


def test_engines_start_at_a_power_of_ten_and_have_their_bound_in_red() -> None:
    """An engine without a bound has its mark at the left edge, where nobody sees it."""
    axes = speed_figure("machine", MEASURED).axes[0]
    assert bars(axes) == [
        ("small", 10.0, 30.0, to_hex(BLUE)),
        ("large", 10.0, 2500.0, to_hex(BLUE)),
    ]
    assert [to_hex(line.get_color()) for line in axes.lines] == [to_hex(RED)] * 2
    assert [np.asarray(line.get_xdata()).tolist() for line in axes.lines] == [
        [80.0, 80.0],
        [10.0, 10.0],
    ]
    assert axes.get_xscale() == "log"
    assert axes.get_xlim()[0] == 10.0


def test_agents_that_were_measured() -> None:
    axes = speed_figure("machine", MEASURED).axes[1]
    assert bars(axes) == [("torch", 0.0, 74.0, to_hex(BLUE))]


@pytest.mark.parametrize(
    ("kinds", "panels"), [({"memory"}, 0), ({"memory", "engine"}, 1), ({"policy"}, 1)]
)
def test_what_was_not_measured_has_no_panel(kinds: set[str], panels: int) -> None:
    figure = speed_figure("machine", [m for m in MEASURED if m.kind in kinds])
    assert len(figure.axes) == panels
