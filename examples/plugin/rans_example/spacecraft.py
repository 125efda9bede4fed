"""A small puck on a table."""

from rans import Spacecraft, Thruster


def puck() -> Spacecraft:
    """3 kg, with a pair of opposite nozzles of 0.5 N at each end of a cross of 0.3 m, both along the rim."""
    ends = (
        ((0.15, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ((0.0, 0.15, 0.0), (-1.0, 0.0, 0.0)),
        ((-0.15, 0.0, 0.0), (0.0, -1.0, 0.0)),
        ((0.0, -0.15, 0.0), (1.0, 0.0, 0.0)),
    )
    thrusters = [
        Thruster(place, (sign * x, sign * y, 0.0), 0.5)
        for place, (x, y, _) in ends
        for sign in (1.0, -1.0)
    ]
    inertia = ((0.03, 0.0, 0.0), (0.0, 0.03, 0.0), (0.0, 0.0, 0.04))
    return Spacecraft("puck", 2, 3.0, inertia, tuple(thrusters), radius=0.15, shape="cylinder")
