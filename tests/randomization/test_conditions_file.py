"""Conditions written down are the conditions read back."""

from dataclasses import replace

import pytest

from rans import Conditions, ConfigError, ThrusterConditions
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
def test_text_gives_the_same_conditions(name, tmp_path):
    file = tmp_path / "own.toml"
    file.write_text(conditions_text(CASES[name]), "utf-8")
    assert load_conditions(file) == CASES[name]


def test_only_what_is_not_the_default_is_written():
    assert conditions_text(Conditions(thrusters=ThrusterConditions(latency=(0.0, 0.1)))) == (
        "thrusters = { latency = [0.0, 0.1] }\n"
    )


def test_a_missing_file_is_told_once(tmp_path):
    with pytest.raises(ConfigError) as caught:
        load_conditions(tmp_path / "own.toml")
    assert str(caught.value).count("own.toml") == 1


def test_a_base_gives_what_a_file_leaves_out(tmp_path):
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
