"""Checks fail when they should, and reports say so."""

from __future__ import annotations

import json
import math

import pytest

from validation.study.checks import Check, Curve, Skipped, Study


def check(value: float) -> Check:
    return Check("way flown", value, 1e-3, "m", "A millimetre is what a ruler shows.")


@pytest.mark.parametrize(
    ("within", "beyond"), [(0.0, math.nan), (1e-3, 1.001e-3), (-1e-3, -1.001e-3), (0.0, -math.inf)]
)
def test_beyond_the_tolerance_or_undefined_fails(within, beyond):
    assert check(within).passed
    assert not check(beyond).passed


def test_a_report_passes_only_if_all_of_at_least_one_check_do():
    assert Study("one", (check(0.0),)).passed
    assert not Study("two", (check(0.0), check(1.0))).passed
    assert not Study("none", ()).passed


def test_report_as_json_holds_everything_and_no_nan(tmp_path):
    file = tmp_path / "new" / "report.json"
    curve = Curve("figure", "ours", (1.0, 2.0), (3.0, 4.0))
    checks = check(5e-4), check(math.nan)
    Study("mixed", checks, {"seed": 3}, (Skipped("kernel", "No GPU."),), (curve,)).write(file)
    read = json.loads(file.read_text("utf-8"), parse_constant=pytest.fail)
    assert not read["passed"]
    assert read["settings"] == {"seed": 3}
    assert read["skipped"] == [{"name": "kernel", "reason": "No GPU."}]
    assert read["curves"][0]["y"] == [3.0, 4.0]
    assert [c["passed"] for c in read["checks"]] == [True, False]
    assert [c["value"] for c in read["checks"]] == [5e-4, "nan"]
    assert read["checks"][0]["reason"] == "A millimetre is what a ruler shows."
    assert {"drake", "torch", "numpy", "python", "processor", "cores"} <= read["environment"].keys()
