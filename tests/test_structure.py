"""TOML that would keep its reader busy for minutes: one sentence at once."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rans.errors import ConfigError
from rans.fast.learn.recipes import training
from rans.model.spacecraft_file import load_spacecraft, spacecraft_text
from rans.randomization.conditions_file import load_conditions
from rans.structure import read_toml

PARTS = "a." * 20_000 + "b = 1"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (PARTS, "at most 16 parts"),
        ('"a" . ' * 20_000 + "b = 1", "at most 16 parts"),
        (f"x = {{ y = 1, {PARTS} }}", "at most 16 parts"),
        # The fourth quote belongs to the text; taken for the beginning of another it would hide the key.
        (f'x = {{ y = """z"""", {PARTS}, w = "" }}', "at most 16 parts"),
        (f"x = {{ y = '''z'''', {PARTS}, w = '' }}", "at most 16 parts"),
        ("".join(f"[{'a.' * 800}b{k}]\n" for k in range(600)), "at most 16 parts"),
        (
            "".join(f"[{'a.' * 800}b{k}]\n" for k in range(3000)),
            "at most 1,048,576 characters beside",
        ),
        ("x = " + "[" * 200 + "]" * 200, "at most 64 deep"),
        ("# " + "x" * 2**24, "at most 16,777,216 characters"),
    ],
    ids=["key", "quoted", "inline", "quotes", "literal", "tables", "long", "deep", "comment"],
)
def test_what_takes_long_is_told_at_once(text: str, sentence: str) -> None:
    """Each is refused by its bound, before it is read; read, the sixth takes minutes."""
    with pytest.raises(ConfigError, match=sentence):
        read_toml(text)


def test_dots_elsewhere_are_no_keys() -> None:
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
def test_a_file_of_another_kind_is_called_by_its_kind(
    kind: str, expected: str, tmp_path: Path
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(FILES[kind])
    if kind == expected:
        READERS[expected](file)
    else:
        with pytest.raises(ConfigError, match=rf"mine.toml: .*{kind} file.*{expected} file"):
            READERS[expected](file)
