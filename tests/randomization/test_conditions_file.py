"""Conditions written down are the conditions read back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rans.errors import ConfigError
from rans.randomization.conditions import Conditions, ThrusterConditions
from rans.randomization.conditions_file import CONDITIONS, conditions_text, load_conditions
from tests.support.worlds import EFFECTS

MIXED = Conditions(
    description='Fälle, "quoted" and \x7f',
    weight=0.5,
    thrusters=ThrusterConditions(droop=0.0, latency=(1e-7, 0.1)),
    others=(Conditions(thrusters=ThrusterConditions(droop=0.1), weight=3.0),),
)
CASES = {
    "mixed": MIXED,
    **EFFECTS,
    **{name: CONDITIONS[name].conditions for name in CONDITIONS.built_in},
}


@pytest.mark.parametrize("name", CASES)
def test_text_gives_the_same_conditions(name: str, tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text(conditions_text(CASES[name]), "utf-8")
    assert load_conditions(file) == CASES[name]


def test_only_what_is_not_the_default_is_written() -> None:
    assert conditions_text(Conditions(thrusters=ThrusterConditions(latency=(0.0, 0.1)))) == (
        "thrusters = { latency = [0.0, 0.1] }\n"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[thrusters]\nlatensy = 0.1",
            r"conditions\.thrusters: unknown .* 'latensy' \(did you mean latency\?\)",
        ),
        ("[sensors]\nnoise = 0.1", r"conditions\.sensors: unknown key 'noise'"),
        ('[body]\nmass = "2 kg"', r"conditions\.body\.mass must be a number, or .*, got '2 kg'"),
        ("[body]\nmass = [1.0]", r"conditions\.body\.mass must be a number, or .*, got \[1\.0\]"),
        ("[body]\nmass = true", r"conditions\.body\.mass must be a number, or .*, got True"),
        (
            "[body]\nmass = [2, 1]",
            r"body\.mass must be .* the least and the largest of two, got \(2\.0, 1\.0\)",
        ),
    ],
)
def test_wrong_files_say_what_and_where(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text(text, "utf-8")
    with pytest.raises(ConfigError, match=message) as caught:
        load_conditions(file)
    assert str(caught.value).startswith(f"{file}: ")


def test_a_missing_file_is_told_once(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load_conditions(tmp_path / "own.toml")
    assert str(caught.value).count("own.toml") == 1


def test_a_base_gives_what_a_file_leaves_out(tmp_path: Path) -> None:
    """In its parts too: of several worlds each has its own."""
    file = tmp_path / "own.toml"
    file.write_text(
        """
        base = "lab"
        body.mass = 1.0
        others = [{ base = "lab", thrusters.latency = 0.3 }, {}]
        """,
        "utf-8",
    )
    lab = load_conditions("lab")
    found = load_conditions(file)
    assert replace(found, others=()) == replace(lab, body=replace(lab.body, mass=1.0))
    late = replace(lab, thrusters=replace(lab.thrusters, latency=0.3))
    assert found.others == (late, Conditions())
    for wrong in ('"nobody"', "3", "[1]", f'"{file}"'):
        file.write_text(f"base = {wrong}", "utf-8")
        with pytest.raises(ConfigError, match="base must be the name of conditions"):
            load_conditions(file)
