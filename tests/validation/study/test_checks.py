"""Checks fail when they should, and reports say so."""

from __future__ import annotations

import json
import math

import pytest
from rich.console import Console

from rans.terminal import rendered
from validation.study.checks import Check, Curve, Skipped, Study


def check(value: float) -> Check:
    return Check("way flown", value, 1e-3, "m", "A millimetre is what a ruler shows.")


@pytest.mark.parametrize(
    ("within", "beyond"), [(0.0, math.nan), (1e-3, 1.001e-3), (-1e-3, -1.001e-3), (0.0, -math.inf)]
)
def test_beyond_the_tolerance_or_undefined_fails(within: float, beyond: float) -> None:
    assert check(within).passed
    assert not check(beyond).passed


def test_a_report_passes_only_if_all_of_at_least_one_check_do() -> None:
    assert Study("one", (check(0.0),)).passed
    assert not Study("two", (check(0.0), check(1.0))).passed
    assert not Study("none", ()).passed


def test_report_as_json_holds_everything_and_no_nan(tmp_path) -> None:
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


def test_table_shows_every_check_and_its_verdict() -> None:
    console = Console(width=100, record=True, quiet=True)
    console.quiet = False
    with console.capture() as capture:
        console.print(rendered(Study("mixed", (check(5e-4), check(2.0))).table()))
    lines = [line for line in capture.get().splitlines() if "way flown" in line]
    assert ["pass" in line for line in lines] == [True, False]
    assert ["FAIL" in line for line in lines] == [False, True]
    assert "5.0e-04" in lines[0]
    assert "1.0e-03" in lines[0]


def test_a_layer_is_one_line_with_the_check_nearest_to_its_tolerance() -> None:
    checks = (
        Check("force", 2e-13, 1e-12, "N", "", layer="thrusters"),
        Check("torque", -5e-13, 1e-12, "N m", "", layer="thrusters"),
        Check("equal bits", 0.0, 0.0, "-", "", layer="engine"),
        Check("unequal bits", 1.0, 0.0, "-", "", layer="engine"),
    )
    console = Console(width=100, record=True, quiet=True)
    console.quiet = False
    with console.capture() as capture:
        console.print(
            rendered(Study("some", checks, skipped=(Skipped("kernel", "No GPU."),)).layers())
        )
    text = capture.get().splitlines()
    (thrusters,) = [line for line in text if "thrusters" in line]
    assert all(word in thrusters for word in ("2 of 2", "torque", "0.5", "pass"))
    (engine,) = [line for line in text if "engine" in line]
    assert all(word in engine for word in ("1 of 2", "unequal bits", "inf", "FAIL"))
    assert "not run" in next(line for line in text if "kernel" in line)


def test_a_narrow_terminal_cuts_no_number() -> None:
    name = "the name of a check that takes more than half of the terminal's width"
    report = Study("one", (Check(name, 1.26e-9, 1e-9, "kg, N m s", ""),))
    console = Console(width=80, record=True)
    console.print(rendered(report.table()))
    text = console.export_text()
    assert "…" not in text
    assert all(word in text for word in ("1.3e-09", "1.0e-09", "kg, N m s", "FAIL"))
