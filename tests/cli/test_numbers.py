"""Numbers of the command line."""

import pytest

from rans.cli.numbers import whole_number


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("7", 7),
        ("-1", -1),
        ("1_000_000", 1_000_000),
        ("1e6", 1_000_000),
        ("0.3e1", 3),
        ("1M", 1_000_000),
        ("1.5k", 1500),
        ("2G", 2_000_000_000),
    ],
)
def test_counts_as_people_write_them(word, value):
    assert whole_number(word) == value


@pytest.mark.parametrize("word", ["1.5", "many", "", "M", "1e400", "nan", "inf", "1m", "0.0001k"])
def test_what_is_no_count(word):
    with pytest.raises((ValueError, ArithmeticError)):
        whole_number(word)
