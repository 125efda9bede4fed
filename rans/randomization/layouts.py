"""Random layouts of thrusters in the plane: what an agent for any craft is trained on.

A layout is drawn in the frame B of a craft with unit mass and unit radius of gyration, so that a thruster is three
numbers: what it does to the velocity along x and y, and to the spin. For a rigid body nothing else matters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

FAMILIES = "quarters", "pairs", "free"
"""Where thrusters are: in pairs at quarter turns about the centre, in pairs anywhere, or each anywhere."""
DIRECTIONS = "tangential", "slanted", "axes", "any"
"""Where they push: along the rim, up to 60 degrees off it, along two axes of a turned frame, or anywhere."""


@dataclass(frozen=True)
class LayoutRanges:
    """Ranges that layouts are drawn from."""

    fewest: int = 4
    """Smallest number of thrusters: three unbounded directions of twist need four that only push."""
    most: int = 12
    """Largest number of thrusters."""
    unequal: tuple[float, float] = (0.5, 1.5)
    """Forces over their mean, in every second layout; in the others they are equal."""
    least_authority: float = 0.25
    """Smallest accepted `authority_margin`."""
    dead: float = 0.15
    """Probability that a layout has lost one thruster, which then is not a part of it."""


def sample_layout(random: np.random.Generator, ranges: LayoutRanges | None = None) -> np.ndarray:
    """Draw a layout that can push and turn every way: columns (n, 3) of F_x, F_y and torque.

    Mass and inertia are 1, the mean force is 1, and the root mean square of the lever arms is 1.
    """
    ranges = ranges or LayoutRanges()
    while True:
        columns = _drawn(random, ranges)
        if len(columns) > ranges.fewest and random.random() < ranges.dead:
            columns = np.delete(columns, random.integers(len(columns)), axis=0)
        if authority_margin(columns) > ranges.least_authority:
            return columns


def layouts(count: int, seed: int, ranges: LayoutRanges | None = None) -> Iterator[np.ndarray]:
    """Draw so many layouts, each from its own seed, so that the k-th one is the same in every longer draw."""
    for number in range(count):
        yield sample_layout(np.random.default_rng((seed, number)), ranges)


def authority_margin(columns: np.ndarray) -> float:
    """Least support of the twists that thrusters can give, over all directions of twist.

    The support in a direction is the sum of what every thruster gives along it if it helps. Columns (n, 3) are
    first divided by the mean force and by the root mean square of the torques, so that the result has no unit;
    0 means that some direction cannot be given at all. The least support is along the normal of a facet of the
    polytope of twists, and every such normal is that of a plane along two thrusters' columns.
    """
    force = np.hypot(columns[:, 0], columns[:, 1]).mean()
    torque = math.sqrt(np.square(columns[:, 2]).mean())
    if not (force > 0.0 and torque > 0.0):
        return 0.0
    scaled = columns / np.array([force, force, torque])
    first, second = np.triu_indices(len(scaled), 1)
    normals = np.cross(scaled[first], scaled[second])
    lengths = np.linalg.norm(normals, axis=1)
    if lengths.max() < _PARALLEL:
        return 0.0
    normals = normals[lengths > _PARALLEL] / lengths[lengths > _PARALLEL, None]
    along = normals @ scaled.T
    return float(min(np.maximum(side * along, 0.0).sum(axis=1).min() for side in (1.0, -1.0)))


_PARALLEL = 1e-9
"""Sine of the angle up to which two columns count as parallel."""
Shape = tuple[tuple[float, ...], ...]
"""A layout's columns, sorted, in units of its own."""


def canonical(columns: np.ndarray, digits: int = 3) -> frozenset[Shape]:
    """All sorted tables of a layout's columns and of its mirror image, turned so that any thruster comes first.

    Two layouts are equal up to the order of their thrusters, a turn of the axes, a mirror, and the units of mass,
    inertia and force if the sets have a member in common. Numbers are rounded to so many digits.
    """
    force = np.hypot(columns[:, 0], columns[:, 1]).mean()
    torque = math.sqrt(np.square(columns[:, 2]).mean()) or 1.0
    scaled = columns / np.array([force, force, torque])
    tables = set()
    for hand in (1.0, -1.0):
        image = scaled * np.array([1.0, hand, hand])
        for x, y, _ in image:
            size = math.hypot(x, y)
            turn = np.array([[x, -y], [y, x]]) / size
            rows = np.column_stack([image[:, :2] @ turn, image[:, 2]])
            # Zero has one sign only.
            rows = np.round(rows, digits) + 0.0
            tables.add(tuple(sorted(map(tuple, rows.tolist()))))
    return frozenset(tables)


def _drawn(random: np.random.Generator, ranges: LayoutRanges) -> np.ndarray:
    """Columns of one layout, which may not be able to push and turn every way."""
    family = FAMILIES[random.integers(len(FAMILIES))]
    count = int(random.integers(ranges.fewest, ranges.most + 1))
    if family != "free":
        count -= count % 2

    # Places: pairs stand side by side, a little apart.
    if family == "free":
        angle = random.uniform(0.0, math.tau, count)
        radius = random.uniform(0.4, 1.4, count)
    else:
        pairs = count // 2
        turn = random.uniform(0.0, math.tau)
        centres = (
            turn + 0.5 * math.pi * np.arange(pairs)
            if family == "quarters"
            else random.uniform(0.0, math.tau, pairs)
        )
        apart = random.uniform(0.0, 0.6)
        angle = np.stack([centres - apart, centres + apart], axis=1).ravel()
        radius = np.full(count, 1.0)
    place = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)

    # Directions: the two of a pair push opposite ways along the rim.
    kind = DIRECTIONS[random.integers(len(DIRECTIONS))]
    sense = np.where(np.arange(count) % 2 == 0, 1.0, -1.0)
    if family == "free":
        sense = random.choice([-1.0, 1.0], count)
    along = angle + 0.5 * math.pi * sense
    if kind == "slanted":
        along = along + sense * random.uniform(-math.pi / 3.0, math.pi / 3.0)
    elif kind == "axes":
        frame = random.uniform(0.0, math.tau)
        along = frame + 0.5 * math.pi * np.round((along - frame) / (0.5 * math.pi))
    elif kind == "any":
        along = random.uniform(0.0, math.tau, count)
    force = random.uniform(*ranges.unequal, count) if random.random() < 0.5 else np.ones(count)

    # Columns, in units of the mean force and of the root mean square of the arms.
    push = (force / force.mean())[:, None] * np.stack([np.cos(along), np.sin(along)], axis=1)
    place = place / math.sqrt(np.square(radius).mean())
    torque = place[:, 0] * push[:, 1] - place[:, 1] * push[:, 0]
    return np.column_stack([push, torque])
