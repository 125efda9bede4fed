"""What formulas of problems may be."""

from __future__ import annotations

import pytest
from rans_proof.formula import formula_value

from rans.errors import ConfigError


def test_a_sum_of_many_parts_is_refused_by_what_is_counted() -> None:
    """It is flat for its reader, who would wonder what is nested; brackets halve the depth."""
    parts = [f"{k} * x" for k in range(60)]
    with pytest.raises(ConfigError, match=r"more than 50 operations within operations.*brackets"):
        formula_value(" + ".join(parts), {"x": 2.0})
    halves = (" + ".join(half) for half in (parts[:30], parts[30:]))
    assert formula_value(" + ".join(f"({half})" for half in halves), {"x": 2.0}) == 60 * 59
