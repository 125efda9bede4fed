from __future__ import annotations

from validation.speed.measurement import Measurement
from validation.speed.ratios import bounds


def test_shares_of_bounds() -> None:
    """Figures without a value or a bound have no share."""
    measured = [
        Measurement("engine", "x", 50.0, "M steps/s", bound=200.0, bound_name="y"),
        Measurement("engine", "z", None, "M", bound=1.0),
        Measurement("engine", "w", 1.0, "M"),
    ]
    (share,) = bounds(measured)
    assert (share.name, share.value, share.note) == ("x: share of y", 0.25, "50 of 200 M steps/s")
