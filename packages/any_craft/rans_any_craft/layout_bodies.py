"""Random layouts of thrusters as bodies and as spacecraft of their own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rans.extend import Body, ConfigError, Spacecraft
from rans.model.body import Mounting
from rans.model.spacecraft import Thruster
from rans_any_craft.layouts import LayoutRanges, layouts

_NORMAL = 1e-6
"""Largest torque along a thruster's force of 1, far above rounding and far below that of unequal moments."""

_FEWEST = {2: 4, 3: 7}
"""Smallest number of thrusters by dimension: they only push, so that three numbers of a twist need four of them."""


def layout_spacecraft(craft: Spacecraft, layout: np.ndarray) -> Spacecraft:
    """Spacecraft whose thrusters are a layout, with everything else of another one.

    Args:
        craft: gives everything but the thrusters; their mean force and their root mean square distance from the
            centre of mass are the units of the layout.
        layout: columns of thrusters, such as `rans_any_craft.layouts.sample_layout` draws: (n, 3) of F_x, F_y
            and torque in the plane, or (n, 6) of force and torque in space, where the torque is normal to the
            force (`rans_any_craft.layouts.LayoutRanges.moments` of 0). A thruster stands where the line of
            its force is nearest to the centre of mass.

    Raises:
        ConfigError: the columns are not those of thrusters in the dimension of the craft.
    """
    size = craft.dimension
    rows = np.zeros((len(layout), 6))
    if layout.shape != (len(layout), craft.degrees_of_freedom):
        raise ConfigError(
            f"a layout for {craft.name!r}, which moves in {size} dimensions, has {craft.degrees_of_freedom} "
            f"numbers for each thruster, got columns of the shape {layout.shape}."
        )
    rows[:, :size] = layout[:, :size]
    rows[:, -1 if size == 2 else 3 :] = layout[:, size:]
    centre = np.array(craft.centre_of_mass)
    mean = float(np.mean([thruster.force for thruster in craft.thrusters]))
    arms = np.array([thruster.position for thruster in craft.thrusters]) - centre
    distance = math.sqrt(float(np.square(arms[:, :size]).sum(axis=1).mean()))
    forces = np.linalg.norm(rows[:, :3], axis=1)
    along = np.abs((rows[:, :3] * rows[:, 3:]).sum(axis=1))
    if not (forces > 0.0).all() or (along > _NORMAL * forces).any():
        raise ConfigError(
            "a thruster has a force above 0, and a torque that is normal to it; the usual cause is a layout with "
            "wheels, or one of unequal moments of inertia: draw it with wheels=0.0 and moments=0.0 in LayoutRanges."
        )
    directions = rows[:, :3] / forces[:, None]
    # The arm d x t / F has the torque t of a force F along a unit vector d.
    places = centre + np.cross(directions, rows[:, 3:] / forces[:, None]) * distance
    supplies = [thruster.supply for thruster in craft.thrusters] + [0] * len(layout)
    thrusters = tuple(
        Thruster(tuple(place), tuple(direction), mean * force, supply)
        for place, direction, force, supply in zip(
            places.tolist(), directions.tolist(), forces.tolist(), supplies, strict=False
        )
    )
    return replace(craft, thrusters=thrusters)


def layout_bodies(craft: Spacecraft, count: int, seed: int = 0) -> Body:
    """Bodies of random layouts of a craft's thrusters, as arrays (count,), for `rans.Engine` (``body=``).

    A layout has from four thrusters (seven in space) up to as many as the craft, with its mean force and its root
    mean square distance from the centre of mass. A thruster of the craft moves to its position in the layout, and
    its gain is the force there over its own. The last thrusters are those that a layout lacks; they have no gain.

    Args:
        craft: spacecraft, whose mass and inertia stay.
        count: number of layouts.
        seed: of the layouts; layout k of a seed is the same for every count.

    Raises:
        ConfigError: the craft has too few thrusters, or they share their force.
    """
    size = craft.dimension
    fewest = _FEWEST[size]
    if craft.thruster_count < fewest or craft.thrust_sharing != "none":
        raise ConfigError(
            f"random layouts are for craft with at least {fewest} thrusters that do not share their force (4 in "
            f"the plane, 7 in space), and {craft.name!r} has {craft.thruster_count} with "
            f'thrust_sharing = "{craft.thrust_sharing}".'
        )
    ranges = LayoutRanges(dimension=size, fewest=fewest, most=craft.thruster_count, moments=0.0)
    shape = (count, craft.thruster_count)
    gain = np.zeros(shape)
    offset = np.zeros((*shape, size))
    designed = [t.direction[:size] for t in craft.thrusters]
    direction = np.broadcast_to(designed, (*shape, size)).copy()
    for number, layout in enumerate(layouts(count, seed, ranges)):
        pairs = zip(layout_spacecraft(craft, layout).thrusters, craft.thrusters, strict=False)
        for k, (thruster, usual) in enumerate(pairs):
            gain[number, k] = thruster.force / usual.force
            offset[number, k] = np.subtract(thruster.position, usual.position)[:size]
            direction[number, k] = thruster.direction[:size]
    mountings = (Mounting(tuple(offset[:, k].T), tuple(direction[:, k].T)) for k in range(shape[1]))
    return replace(Body.of(craft), gain=tuple(gain.T), mountings=tuple(mountings))
