"""Any spacecraft, through every layer that looks at single moments and periods.

Hypothesis shrinks a failure to the simplest spacecraft that shows it, and the message is its file.
"""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, Phase, given, settings, strategies as st

from rans.model.spacecraft_file import to_toml
from tests.support.crafts import spacecraft
from validation.study.checks import Check
from validation.study.study import LAYERS, Scope

_SHORT = ("thrusters", "commands", "mass", "accelerations", "period", "invariants")


@pytest.fixture(autouse=True)
def _short_coasts(monkeypatch) -> None:
    """What breaks a law does so within a second too."""
    monkeypatch.setattr("validation.study.invariants._COAST", 1.0)


@pytest.mark.slow
@pytest.mark.parametrize(("dimension", "examples"), [(2, 20), (3, 2)])
def test_any_spacecraft(dimension, examples):
    # A failure is not explained, which takes longer than to find it.
    @settings(
        max_examples=examples,
        suppress_health_check=[HealthCheck.too_slow],
        phases=[Phase.generate, Phase.shrink],
    )
    @given(craft=spacecraft(dimension), seed=st.integers(0, 2**32 - 1))
    def check(craft, seed):
        scope = Scope(craft, seed, states=8, flights=1)
        for name in _SHORT:
            failed = [c for c in LAYERS[name](scope) if isinstance(c, Check) and not c.passed]
            assert not failed, f"{failed}\nwith seed {seed} of this spacecraft:\n{to_toml(craft)}"

    check()
