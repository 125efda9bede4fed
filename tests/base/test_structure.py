"""TOML that would keep its reader busy for minutes: one sentence at once."""

import json

import pytest

from rans import ConfigError
from rans.base.structure import read_toml
from rans.fast.learn.config import training
from rans.model.spacecraft_file import load_spacecraft, spacecraft_text
from rans.randomization.conditions_file import load_conditions


def test_dots_elsewhere_are_no_keys():
    numbers = [k + 0.5 for k in range(100)]
    dots = json.dumps("v 0.1 0.2 0.3\\n" * 1000 + "." * 100)
    table = read_toml(f"x = {numbers}\ny = {dots}  # {'.' * 100}\nz = '{'.' * 100}'\na.b.c = 1\n")
    assert table["x"] == numbers
    assert table["y"] == json.loads(dots)
    assert table["a"]["b"]["c"] == 1


FILES = {
    "spacecraft": spacecraft_text("floating-platform"),
    "conditions": "[thrusters]\nlatency = 0.1\n",
    "recipe": 'task = "go-to-pose"\nspacecraft = "floating-platform"\n[settings]\nthrust_weight = 0.1\n',
}
READERS = {
    "spacecraft": load_spacecraft,
    "conditions": load_conditions,
    "recipe": lambda file: training(str(file), device="cpu"),
}


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("expected", READERS)
def test_a_file_of_another_kind_is_called_by_its_kind(kind, expected, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(FILES[kind])
    if kind == expected:
        READERS[expected](file)
    else:
        with pytest.raises(ConfigError, match=rf"mine.toml: .*{kind} file.*{expected} file"):
            READERS[expected](file)
