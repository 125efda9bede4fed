"""Random layouts of thrusters as bodies and as spacecraft of their own."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from rans.errors import ConfigError
from rans.model.body import Body, Mounting
from rans.model.spacecraft import Spacecraft, Thruster
from rans.model.twists import thrust
from rans.randomization.conditions import LayoutConditions
from rans.randomization.layouts import LayoutRanges, layouts


def layout_spacecraft(craft: Spacecraft, layout: np.ndarray) -> Spacecraft:
    """Spacecraft in the plane whose thrusters are a layout, with the mass, inertia and kind of another one.

    Args:
        craft: gives everything but the thrusters; their mean force and their root mean square distance from the
            centre of mass are the units of the layout.
        layout: columns (n, 3) of F_x, F_y and torque, such as `rans.randomization.layouts.sample_layout` draws. A
            thruster stands where the line of its force is nearest to the centre of mass.

    Raises:
        ConfigError: the craft moves in space.
    """
    if craft.dimension != 2:
        raise ConfigError(
            f"layouts of thrusters are for craft in the plane; {craft.name!r} moves in space."
        )
    centre = np.array(craft.centre_of_mass)
    mean = float(np.mean([thruster.force for thruster in craft.thrusters]))
    arms = np.array([thruster.position for thruster in craft.thrusters]) - centre
    distance = math.sqrt(float(np.square(arms).sum(axis=1).mean()))
    forces = thrust(layout)
    thrusters = []
    supplies = [thruster.supply for thruster in craft.thrusters] + [0] * len(layout)
    for (x, y, torque), force, supply in zip(
        layout.tolist(), forces.tolist(), supplies, strict=False
    ):
        direction = (x / force, y / force, 0.0)
        # The arm (d_y, -d_x) s has the torque s F about z, along a unit vector d.
        arm = torque / force * distance
        place = centre + arm * np.array([direction[1], -direction[0], 0.0])
        thrusters.append(Thruster(tuple(place.tolist()), direction, mean * force, supply))
    return replace(craft, thrusters=tuple(thrusters))


@lru_cache(maxsize=8)
def layout_bodies(craft: Spacecraft, drawn: LayoutConditions) -> Body:
    """Bodies of all random layouts of the conditions, as arrays (count,).

    A thruster of the craft moves to its place in the layout, and its gain is the force there over its own. The
    thrusters that a layout lacks have no gain.
    """
    ranges = LayoutRanges(fewest=drawn.fewest, most=craft.thruster_count)
    shape = (drawn.count, craft.thruster_count)
    gain = np.zeros(shape)
    offset = np.zeros((*shape, 2))
    direction = np.broadcast_to([t.direction[:2] for t in craft.thrusters], (*shape, 2)).copy()
    for number, layout in enumerate(layouts(drawn.count, drawn.seed, ranges)):
        pairs = zip(layout_spacecraft(craft, layout).thrusters, craft.thrusters, strict=False)
        for k, (thruster, designed) in enumerate(pairs):
            gain[number, k] = thruster.force / designed.force
            offset[number, k] = np.subtract(thruster.position, designed.position)[:2]
            direction[number, k] = thruster.direction[:2]
    mountings = (Mounting(tuple(offset[:, k].T), tuple(direction[:, k].T)) for k in range(shape[1]))
    return replace(Body.of(craft), gain=tuple(gain.T), mountings=tuple(mountings))
