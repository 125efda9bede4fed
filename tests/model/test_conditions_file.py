"""Conditions written down are the conditions read back."""

from __future__ import annotations

from pathlib import Path

import pytest

from rans.model.conditions import Conditions, ThrusterConditions
from rans.model.conditions_file import CONDITIONS, conditions_text, load_conditions
from tests.worlds import EFFECTS

MIXED = Conditions(description='Fälle, "quoted" and \x7f', weight=0.5,
                   thrusters=ThrusterConditions(fall=0.0, latency=(1e-7, 0.1)),
                   others=(Conditions(thrusters=ThrusterConditions(fall=0.1), weight=3.0),))
CASES = {"mixed": MIXED, **EFFECTS, **{name: CONDITIONS[name].conditions for name in CONDITIONS.built_in}}


@pytest.mark.parametrize("name", CASES)
def test_text_gives_the_same_conditions(name: str, tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text(conditions_text(CASES[name]), "utf-8")
    assert load_conditions(file) == CASES[name]


def test_only_what_is_not_the_default_is_written() -> None:
    assert conditions_text(Conditions(thrusters=ThrusterConditions(latency=(0.0, 0.1)))) == (
        "thrusters = { latency = [0.0, 0.1] }\n")
