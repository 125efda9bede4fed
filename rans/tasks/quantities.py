"""Quantities that errors of tasks are of: each is declared once, with all that metrics and pages say about it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rans.errors import ConfigError, brief


@dataclass(frozen=True)
class Quantity:
    """One kind of error, such as the distance from a goal.

    What has a default may be left out: the metrics that need it are then left out too.
    """

    name: str
    """Key in `rans.tasks.base.Task.errors` and in names of tolerances, such as position_tolerance."""
    unit: str
    """SI unit."""
    display_unit: str
    """Unit in tables and figures."""
    display_factor: float = 1.0
    """Numbers in the display unit over those in SI."""
    time_within: tuple[str, tuple[int, ...]] = ("", ())
    """Short name and bounds, in the display unit, of the share of time within bounds. PT and OT are the original
    system's (2023), VT10, VT5 and VT2 its VE1, VE05 and VE02 (2024); ST continues them."""
    threshold: float | None = None
    """The original system's success threshold (2023), SI."""
    threshold_texts: tuple[str, str, str] = ("", "", "")
    """The threshold, its half and 7.5 times it, with units."""
    held: tuple[int, ...] = ()
    """Bounds of three grades of holding a goal, in the display unit."""
    engine_difference: float = math.inf
    """Largest difference of median final errors between two engines that counts as the same, SI: a fiftieth of what
    tasks tolerate; of the share of points that are unseen, a tenth."""

    @property
    def display(self) -> tuple[float, str]:
        """Display factor and unit."""
        return self.display_factor, self.display_unit


QUANTITIES: dict[str, Quantity] = {}
"""All quantities by name, in the order of their declaration."""


def declare(quantity: Quantity) -> None:
    """Make a quantity known, for the errors of a task of your own.

    Raises:
        ConfigError: another quantity has its name.
    """
    if QUANTITIES.get(quantity.name, quantity) != quantity:
        raise ConfigError(
            f"the quantity {brief(quantity.name)} exists already with other units or bounds; choose "
            "another name."
        )
    QUANTITIES[quantity.name] = quantity


_DEGREES = math.degrees(1.0)

declare(
    Quantity(
        "position",
        "m",
        "cm",
        100.0,
        ("PT", (10, 5, 2, 1)),
        0.02,
        ("2 cm", "1 cm", "15 cm"),
        (5, 2, 1),
        1e-3,
    )
)
declare(
    Quantity(
        "attitude",
        "rad",
        "deg",
        _DEGREES,
        ("OT", (5, 2, 1)),
        0.087,
        ("5 deg", "2.5 deg", "37 deg"),
        (3, 2, 1),
        math.radians(0.1),
    )
)
declare(
    Quantity(
        "velocity",
        "m/s",
        "cm/s",
        100.0,
        ("VT", (10, 5, 2, 1)),
        0.15,
        ("15 cm/s", "7.5 cm/s", "113 cm/s"),
        (10, 5, 2),
        1e-3,
    )
)
declare(
    Quantity(
        "spin",
        "rad/s",
        "deg/s",
        _DEGREES,
        ("ST", (20, 10, 5, 2, 1)),
        0.3,
        ("0.3 rad/s", "0.15 rad/s", "2.25 rad/s"),
        (20, 10, 5),
        math.radians(0.1),
    )
)
