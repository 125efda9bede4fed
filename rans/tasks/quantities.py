"""Quantities of errors, each declared once with its units and the bounds that metrics and pages use."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rans.base.errors import ConfigError, brief


@dataclass(frozen=True)
class Quantity:
    """One kind of error, such as the distance from a goal.

    Metrics that need a field which has its default are left out.
    """

    name: str
    """Key in `rans.tasks.base.Task.errors` and in names of tolerances, such as position_tolerance."""
    unit: str
    """SI unit."""
    display_unit: str
    """Unit in tables and figures."""
    display_factor: float = 1.0
    """Factor from SI to the display unit."""
    time_within: tuple[str, tuple[int, ...]] = ("", ())
    """Short name and bounds, in the display unit, of the metrics of time within bounds. PT and OT are those of the
    original system (2023); VT10, VT5 and VT2 are its VE1, VE05 and VE02 (2024); ST continues them."""
    threshold: float | None = None
    """Success threshold of the original system (2023), SI."""
    threshold_texts: tuple[str, str, str] = ("", "", "")
    """Texts of the threshold, half of it and 7.5 times it, with units."""
    held: tuple[int, ...] = ()
    """Bounds of three grades of keeping a goal, in the display unit."""

    @property
    def display(self) -> tuple[float, str]:
        """Display factor and unit."""
        return self.display_factor, self.display_unit


QUANTITIES: dict[str, Quantity] = {}
"""Quantities by name, in the order of their declaration."""


def declare(quantity: Quantity) -> None:
    """Declare a quantity for the errors of a task of your own.

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
        name="position",
        unit="m",
        display_unit="cm",
        display_factor=100.0,
        time_within=("PT", (10, 5, 2, 1)),
        threshold=0.02,
        threshold_texts=("2 cm", "1 cm", "15 cm"),
        held=(5, 2, 1),
    )
)
declare(
    Quantity(
        name="attitude",
        unit="rad",
        display_unit="deg",
        display_factor=_DEGREES,
        time_within=("OT", (5, 2, 1)),
        threshold=0.087,
        threshold_texts=("5 deg", "2.5 deg", "37 deg"),
        held=(3, 2, 1),
    )
)
declare(
    Quantity(
        name="velocity",
        unit="m/s",
        display_unit="cm/s",
        display_factor=100.0,
        time_within=("VT", (10, 5, 2, 1)),
        threshold=0.15,
        threshold_texts=("15 cm/s", "7.5 cm/s", "113 cm/s"),
        held=(10, 5, 2),
    )
)
declare(
    Quantity(
        name="spin",
        unit="rad/s",
        display_unit="deg/s",
        display_factor=_DEGREES,
        time_within=("ST", (20, 10, 5, 2, 1)),
        threshold=0.3,
        threshold_texts=("0.3 rad/s", "0.15 rad/s", "2.25 rad/s"),
        held=(20, 10, 5),
    )
)
