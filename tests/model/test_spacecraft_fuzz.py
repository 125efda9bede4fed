"""Whatever a spacecraft file holds, it is a spacecraft or one sentence."""

from __future__ import annotations

import math
import re
import tomllib
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rans.errors import ConfigError
from rans.model.spacecraft_file import parse_spacecraft
from tests.support.spacecraft_files import VALID, toml

extremes = st.sampled_from(
    [
        0,
        -0.0,
        5e-324,
        1e-310,
        1e-9,
        1e9,
        1e154,
        1e308,
        -1e308,
        2**63,
        -(10**500),
        math.inf,
        math.nan,
    ]
)
reals = st.floats(-10, 10) | st.floats() | extremes
scalars = (
    reals | st.integers(-3, 3) | st.booleans() | st.sampled_from(["none", "sphere", "", "a\nb\0é"])
)
junk = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from("xyz"), inner, max_size=2)
    ),
    max_leaves=12,
)
triples = st.lists(reals, min_size=3, max_size=3)
tensors = st.lists(triples, min_size=3, max_size=3) | triples.map(lambda d: np.diag(d).tolist())


def loads_or_refuses(text: str) -> None:
    """Any text either describes a spacecraft or is refused in one line; nothing else may happen."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "spacecraft .* cannot push and turn", UserWarning)
        try:
            craft = parse_spacecraft(text, "fuzz.toml")
        except ConfigError as error:
            message = str(error)
            assert message.startswith("fuzz.toml: ")
            assert "\n" not in message
        else:
            assert np.isfinite(craft.wrench_map).all()
            assert math.isfinite(np.linalg.det(craft.inertia))


WORDS = [
    *(
        "0",
        "-1",
        "1e308",
        "-1e-320",
        "nan",
        "-inf",
        "0.1",
        "2",
        "3",
        "2.0",
        "true",
        "0x" + "f" * 4000,
    ),
    *(
        "1" + "0" * 400,
        "1_0",
        "1__0",
        ".5",
        "1979-05-27",
        "2024-02-30",
        "07:32:00",
        "[]",
        "[1, 2, 3]",
    ),
    *("{x = 1}", "'y'", '"b"', "=", "#", "[[thruster]]", "\n"),
]


@pytest.mark.slow
@settings(max_examples=500)
@given(st.data())
def test_fuzz_values_at_keys(data: st.DataObject) -> None:
    """500 files: one to three keys of a valid one hold what TOML can say, half of it well formed."""
    table = tomllib.loads(VALID)
    table["dimension"] = data.draw(st.sampled_from([2, 3]))
    holders = [table, *table["thruster"]]
    for holder in holders:  # two numbers do for a vector in the plane only
        short = {key: x for key, x in holder.items() if isinstance(x, list) and len(x) == 2}
        holder.update({key: [*x, 0.0] for key, x in short.items()})
    for _ in range(data.draw(st.integers(1, 3))):
        holder = data.draw(st.sampled_from(holders))
        key = data.draw(st.sampled_from(sorted(holder)))
        fitting = (
            tensors if key == "inertia" else triples if isinstance(holder[key], list) else reals
        )
        holder[key] = data.draw(fitting if data.draw(st.booleans()) else junk)
    loads_or_refuses("\n".join(f"{key} = {toml(value)}" for key, value in table.items()))


@settings(max_examples=500)
@given(st.data())
def test_fuzz_texts(data: st.DataObject) -> None:
    """500 files: a valid one with words exchanged, and sometimes a piece cut out or doubled."""
    parts = re.split(r"([\w.+-]+)", VALID)  # words are at the odd places
    for _ in range(data.draw(st.integers(1, 3))):
        parts[data.draw(st.integers(0, len(parts) // 2 - 1)) * 2 + 1] = data.draw(
            st.sampled_from(WORDS)
        )
    text = "".join(parts)
    if data.draw(st.integers(0, 3)) == 0:
        start = data.draw(st.integers(0, len(text)))
        length = data.draw(st.integers(1, 30))
        text = text[:start] + text[start : start + length] * data.draw(st.sampled_from([0, 2]))
        text += VALID[start + length :]
    loads_or_refuses(text)
