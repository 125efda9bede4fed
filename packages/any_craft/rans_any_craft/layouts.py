"""Random layouts of thrusters in the plane and in space: what an agent for any craft is trained on.

A layout is drawn in the frame B of a craft with unit mass and unit radius of gyration, so that a thruster is three
numbers in the plane, what it does to the velocity along x and y and to the spin, and six in space. For a rigid body
in the plane nothing else matters; in space the ratios of the moments of inertia enter once more, where it spins
fast. A reaction wheel is two columns that push nowhere, one for each way. Training, its held-out test (`canonical`)
and the shipped agents' pools depend on the order in which numbers are drawn here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rans.model.twists import authority_margin, directions, thrust

FAMILIES = "quarters", "pairs", "free"
"""Positions in the plane: in pairs at quarter turns about the centre, in pairs anywhere, or each anywhere."""
FAMILIES_IN_SPACE = "opposed", "mirrored", "free"
"""Positions in space: two opposite thrusters at each, mirror images of a few, or each anywhere."""
DIRECTIONS = "tangential", "slanted", "axes", "any"
"""Forces: along the rim, up to 60 degrees off it, along the axes of a frame, or along any direction."""


@dataclass(frozen=True)
class LayoutRanges:
    """Ranges that layouts are drawn from."""

    dimension: int = 2
    """2: the plane; 3: space."""
    fewest: int = 4
    """Smallest number of thrusters. They only push: three numbers of a twist need four of them, six need seven."""
    most: int = 12
    """Largest number of thrusters."""
    unequal: tuple[float, float] = (0.5, 1.5)
    """Forces over their mean, in every second layout; in the others they are equal."""
    least_authority: float = 0.25
    """Smallest accepted `authority_margin`."""
    dead: float = 0.15
    """Probability that a layout has lost one thruster, which then is not a part of it."""
    wheels: float = 0.0
    """Probability of three reaction wheels about the axes of B, in space."""
    moments: float = 0.6
    """Largest logarithm of the factors on the principal moments of inertia, in space; 0: all moments are equal."""


IN_SPACE = LayoutRanges(dimension=3, fewest=8, most=16, wheels=0.25)
"""Ranges of layouts in space."""


def sample_layout(random: np.random.Generator, ranges: LayoutRanges | None = None) -> np.ndarray:
    """Draw a layout that can push and turn every way: columns (n, 3) of F_x, F_y and torque, or (n, 6) in space.

    Mass and inertia are 1 (in space the mean of the principal moments), the mean force is 1, and the root mean
    square of the lever arms is 1. Columns of wheels come last. Draws again until the layout has the least authority
    that the ranges ask for.
    """
    ranges = ranges or LayoutRanges()
    drawn = _drawn if ranges.dimension == 2 else _drawn_in_space
    while True:
        columns = drawn(random, ranges)
        # Mirror images of one thruster may be more than there is room for.
        if (thrust(columns) > 0.0).sum() > ranges.most:
            continue
        if len(columns) > ranges.fewest and random.random() < ranges.dead:
            thrusters = int((thrust(columns) > 0.0).sum())
            columns = np.delete(columns, random.integers(thrusters), axis=0)
        if authority_margin(columns, ranges.least_authority) > ranges.least_authority:
            return columns


Shape = tuple[tuple[float, ...], ...]
"""A layout's columns, sorted, in units of its own."""


def canonical(columns: np.ndarray, digits: int = 3) -> frozenset[Shape]:
    """All sorted tables of a layout's columns and of its mirror image, turned so that any thruster comes first.

    In space a second thruster then lies in the plane of the first two axes. Two layouts are equal up to the order
    of their thrusters, a turn of the axes, a mirror, and the units of mass, inertia and force if the sets have a
    member in common. Numbers are rounded to so many digits. Wheels, which push nowhere, do not count. Training
    leaves out every layout whose set meets that of a shipped craft.
    """
    columns = columns[thrust(columns) > 0.0]
    pushing = directions(columns.shape[1])
    force = thrust(columns).mean()
    torque = math.sqrt(np.square(columns[:, pushing:]).sum(axis=1).mean()) or 1.0
    forces = columns[:, :pushing] / force
    torques = columns[:, pushing:] / torque
    tables = set()
    for frame in _frames(forces):
        # A mirror image reverses torques as seen in the mirrored axes.
        hand = np.linalg.det(frame)
        turned = torques * hand if pushing == 2 else hand * torques @ frame.T
        # Zero has one sign only.
        rows = np.round(np.column_stack([forces @ frame.T, turned]), digits) + 0.0
        tables.add(tuple(sorted(map(tuple, rows.tolist()))))
    return frozenset(tables)


def _frames(forces: np.ndarray) -> Iterator[np.ndarray]:
    """Orthogonal matrices (d, d) of both hands that turn each force, in space with a second one, to axes.

    ``forces`` are (thrusters, d) in B. Each of a layout's own frames is there, so that equal layouts share one.
    """
    for force in forces:
        first = force / np.linalg.norm(force)
        if len(first) == 2:
            across = np.array([-first[1], first[0]])
            yield np.stack([first, across])
            yield np.stack([first, -across])
            continue
        for other in forces:
            across = other - first * (first @ other)
            # Nearly parallel forces do not give a frame.
            if (length := np.linalg.norm(across)) > 0.1 * np.linalg.norm(other):
                second = across / length
                third = np.cross(first, second)
                yield np.stack([first, second, third])
                yield np.stack([first, second, -third])


def _drawn(random: np.random.Generator, ranges: LayoutRanges) -> np.ndarray:
    """Columns (thrusters, 3) of a layout, perhaps unable to move every way; pools rely on the order of draws.

    In the frame of unit mass and unit radius of gyration; the caller keeps those that can be steered.
    """
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


def _drawn_in_space(random: np.random.Generator, ranges: LayoutRanges) -> np.ndarray:
    """Columns (thrusters and wheels, 6) of a layout, perhaps unable to move every way.

    Pools rely on the order of draws.
    """
    family = FAMILIES_IN_SPACE[random.integers(len(FAMILIES_IN_SPACE))]
    kind = DIRECTIONS[random.integers(len(DIRECTIONS))]
    has_wheels = random.random() < ranges.wheels
    count = int(random.integers(ranges.fewest, ranges.most + 1))

    # Positions in a box: a few, whose images are added below.
    images = [np.eye(3)]
    if family == "mirrored":
        signs = np.array(list(itertools.product((1.0, -1.0), repeat=3)))
        # All eight octants, or the four with an even number of mirrors.
        if random.random() < 0.5:
            signs = signs[signs.prod(axis=1) > 0.0]
        images = [np.diag(sign) for sign in signs]
    size = random.uniform(0.4, 1.0, 3)
    seeds = max(1, count // (2 if family == "opposed" else len(images)))
    position = random.uniform(-1.0, 1.0, (seeds, 3)) * size

    # Forces.
    unit = _unit(random.normal(size=(seeds, 3)))
    if kind in ("tangential", "slanted"):
        along = _unit(np.cross(position, unit))
        if kind == "slanted":
            off = random.uniform(0.0, math.pi / 3.0)
            along = math.cos(off) * along - math.sin(off) * _unit(position)
    elif kind == "axes":
        axis = random.integers(3, size=seeds)
        along = np.eye(3)[axis] * random.choice([-1.0, 1.0], (seeds, 1))
    else:
        along = unit
    if family == "opposed":
        position = np.vstack([position, position])
        along = np.vstack([along, -along])
    position = np.vstack([position @ image for image in images])
    along = np.vstack([along @ image for image in images])

    # A craft with wheels may have thrusters that hardly turn it, or not at all.
    if has_wheels:
        position = position * random.choice([0.0, 0.3, 1.0])
    number = len(position)
    force = random.uniform(*ranges.unequal, number) if random.random() < 0.5 else np.ones(number)

    # Columns, in units of the mean force and of the root mean square of the arms; unequal moments of inertia.
    push = (force / force.mean())[:, None] * along
    arm = math.sqrt(np.square(position).sum(axis=1).mean()) or 1.0
    moments = np.exp(random.uniform(-ranges.moments, ranges.moments, 3))
    torque = np.cross(position / arm, push) / (moments / moments.mean())
    columns = np.column_stack([push, torque])
    if has_wheels:
        wheel = np.column_stack([np.zeros((3, 3)), np.diag(np.exp(random.uniform(-1.0, 1.0, 3)))])
        columns = np.vstack([columns, wheel, -wheel])

    # In every second layout the axes of B are not those of the layout.
    if random.random() < 0.5:
        turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
        turn *= np.sign(np.linalg.det(turn))
        columns = np.column_stack([columns[:, :3] @ turn.T, columns[:, 3:] @ turn.T])
    return columns


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) of length 1."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
