"""Control allocation: which commands of a craft come closest to a demanded change of its twist in a control period.

A twist in B is (v_x, v_y, w_z) in the plane, and three velocities, then three angular velocities, in space. Every
thruster changes it by a column in a period, in the units of the craft's least authority, so that a demand of 1
along an axis can always be met. On/off thrusters are chosen as the subset with the least squared error plus a price
of its thrust: the search over all subsets is the search for the largest of linear functions of the demand.
Continuous thrusters are found by coordinate descent on the same cost.

The smaller the authority margin of on/off thrusters, the more thrust a unit of a demand takes, since thrusters push
against each other. In the plane their price falls with it (`thrust_price`), or demands near the goal would not be
worth it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rans.extend import Field, where, within
from rans_any_craft.twists import authority_margin, directions

PRICE = 0.1
"""Price of the velocity change that thrusters give, summed over them, in units of squared errors: of thrusters in
the plane, and beside wheels, which fill up with the torques that thrusters leave."""
ON_OFF_PRICE = {2: PRICE, 3: 0.13}
"""Price of the velocity change of on/off thrusters, in units of squared errors, by dimension
(docs/decisions/any_craft.md)."""
CONTINUOUS_PRICE = {2: PRICE, 3: 0.2}
"""Price of the velocity change of throttled or pulsed thrusters of a craft without wheels, in units of squared
errors, by dimension (docs/decisions/any_craft.md)."""
FALL = 2.0
"""Power of an authority margin below 1 by which the price of thrusters falls, apart from continuous ones in the
plane (docs/decisions/any_craft.md)."""
PASSES = 6
"""Times that coordinate descent visits every thruster. Errors that are left are demanded in the next period."""


def in_order(columns: np.ndarray) -> np.ndarray:
    """Order (n,) of columns by their numbers, in which a layout is the same however its thrusters are numbered."""
    return np.lexsort(columns.T[::-1])


def thrust_price(columns: np.ndarray) -> float:
    """Price of the thrust of on/off thrusters with columns (n, d)."""
    return ON_OFF_PRICE[directions(columns.shape[1])] * _fall(columns)


def _fall(columns: np.ndarray) -> float:
    """Factor of the price of thrusters with columns (n, d): 1, or less with an authority margin below 1."""
    # Summed in one order, so that its bits do not depend on the numbers of the thrusters.
    margin = authority_margin(columns[in_order(columns)])
    return min(1.0, margin) ** FALL


def continuous_price(columns: np.ndarray, has_wheels: bool) -> float:
    """Price of the thrust of continuous thrusters with columns (n, d)."""
    pushing = directions(columns.shape[1])
    if has_wheels or pushing == 2:
        return PRICE
    return CONTINUOUS_PRICE[pushing] * _fall(columns)


def shares(
    demand: Sequence[Field],
    columns: np.ndarray,
    price: Field,
    limits: Sequence[Field | None] | None = None,
    passes: int = PASSES,
    charges: Sequence[Field] | None = None,
) -> list[Field]:
    """Shares of full force, 0 to 1, of continuous thrusters for a demand of d fields, by coordinate descent.

    Args:
        demand: change of the twist, in units of the authority.
        columns: (n, d). All thrusters begin shut, and are visited in the order of their columns.
        price: of a unit of velocity change that a thruster gives.
        limits: largest share of each thruster; None: 1.
        passes: times that every thruster is visited.
        charges: further price of the full force of each thruster, which may be negative; None: 0.
    """
    pushing = directions(len(demand))
    left = list(demand)
    result: list[Field] = [0.0] * len(columns)
    order = in_order(columns)
    # One thruster at a time, with the demand that the others leave.
    for turn in range(passes):
        for k in order:
            column = [float(x) for x in columns[k]]
            square = sum(x * x for x in column)
            if square == 0.0:
                result[k] = left[0] * 0.0
                continue
            offset = 0.5 * price * math.hypot(*column[:pushing]) / square
            if charges is not None:
                offset = offset + charges[k] * (0.5 / square)
            # Where the cost is least along this thruster, within its range.
            step = sum(x / square * e for x, e in zip(column, left, strict=True)) - offset
            before = result[k]
            after = within(step if turn == 0 else before + step, 0.0, 1.0)
            limit = None if limits is None else limits[k]
            if limit is not None:
                after = where(after < limit, after, limit)
            change = after if turn == 0 else after - before
            left = [e - x * change for x, e in zip(column, left, strict=True)]
            result[k] = after
    return result
