"""Diagrams of boxes and arrows are data: arrows join boxes that are there, and no box covers another."""

from __future__ import annotations

import tomllib
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest

from campaigns import schemes

ROWS: dict[str, Any] = tomllib.loads(Path(schemes.__file__).with_suffix(".toml").read_text("utf-8"))


@pytest.mark.parametrize("name", ROWS)
def test_boxes_stand_apart_within_the_picture_and_arrows_join_two_of_them(name: str) -> None:
    boxes = [(x, y, half[0] if half else 1.1) for _, x, y, *half in ROWS[name].get("boxes", ())]
    width, height = ROWS[name]["size"]
    for x, y, half in boxes:
        assert x - half > -0.1
        assert x + half < width + 0.1
        assert y - 0.4 > -0.1
        assert y + 0.4 < height + 0.1
    for a, b in combinations(boxes, 2):
        assert abs(a[0] - b[0]) >= a[2] + b[2] or abs(a[1] - b[1]) >= 0.8
    for first, second, *_ in ROWS[name].get("ways", ()):
        assert first != second
        assert min(first, second) >= 0
        assert max(first, second) < len(boxes)


def test_a_diagram_has_its_texts() -> None:
    figure = schemes.SCHEMES["pipeline"]()
    texts = {text.get_text() for text in figure.axes[0].texts}
    assert {"rans train", "view, report"} <= texts
