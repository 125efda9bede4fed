"""Any spacecraft, through every layer that looks at single moments and periods.

Hypothesis shrinks a failure to the simplest spacecraft that shows it, and the message is its file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import parse_spacecraft
from rans.reference.plant import Plant
from tests.support.crafts import nasty_planar, nasty_spatial, spacecraft, to_toml
from validation.study.checks import Check
from validation.study.study import LAYERS, Scope

_SHORT = ("thrusters", "commands", "mass", "accelerations", "period", "invariants")


@pytest.fixture(autouse=True)
def _short_coasts(monkeypatch: pytest.MonkeyPatch) -> None:
    """What breaks a law does so within a second too."""
    monkeypatch.setattr("validation.study.invariants._COAST", 1.0)


def assert_trusted(craft: Spacecraft, seed: int) -> None:
    scope = Scope(craft, seed, states=8, flights=1)
    for name in _SHORT:
        failed = [c for c in LAYERS[name](scope) if isinstance(c, Check) and not c.passed]
        assert not failed, f"{failed}\nwith seed {seed} of this spacecraft:\n{to_toml(craft)}"


def any_spacecraft(dimension: Literal[2, 3], examples: int) -> Callable[[], None]:
    # A failure is not explained, which takes longer than to find it.
    @settings(
        max_examples=examples,
        suppress_health_check=[HealthCheck.too_slow],
        phases=[Phase.generate, Phase.shrink],
    )
    @given(craft=spacecraft(dimension), seed=st.integers(0, 2**32 - 1))
    def check(craft: Spacecraft, seed: int) -> None:
        assert_trusted(craft, seed)

    return check


@pytest.mark.slow
@pytest.mark.parametrize(("dimension", "examples"), [(2, 60), (3, 2)])
def test_any_spacecraft(dimension: Literal[2, 3], examples: int) -> None:
    any_spacecraft(dimension, examples)()


@pytest.mark.filterwarnings(
    "ignore:spacecraft 'random'"
)  # shrunk to one thruster, it cannot be controlled
def test_a_failure_shrinks_to_a_file_that_shows_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drake's forces are doubled: the simplest spacecraft that notices has a single thruster."""
    true = Plant.thruster_wrenches
    monkeypatch.setattr(Plant, "thruster_wrenches", lambda self: 2.0 * true(self))
    with pytest.raises(AssertionError, match="every thruster: force") as failure:
        any_spacecraft(2, 20)()
    text = str(failure.value).partition("of this spacecraft:\n")[2].partition("\nassert")[0]
    assert text.count("[[thruster]]") == 1
    craft = parse_spacecraft(text, "shrunk.toml")
    with pytest.raises(AssertionError, match="every thruster: force"):
        assert_trusted(craft, 0)


@pytest.mark.parametrize("craft", [nasty_planar(), nasty_spatial()], ids=["plane", "space"])
def test_the_file_is_the_spacecraft(craft: Spacecraft) -> None:
    again = parse_spacecraft(to_toml(craft), "again.toml")
    assert replace(again, thrusters=craft.thrusters) == craft
    for ours, theirs in zip(craft.thrusters, again.thrusters, strict=True):
        assert replace(theirs, direction=ours.direction) == ours
        assert theirs.direction == pytest.approx(
            ours.direction, rel=1e-15
        )  # made a unit vector again
