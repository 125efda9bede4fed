"""Compiled loops of certificates in space: dynamic program, rigid-body integration and annealing.

States (13,) are p in W, the quaternion of B in W (w, x, y, z), v in W and the angular velocity in B.
"""

from __future__ import annotations

import math

import numpy as np
from rans_bounds.compiled import compiled

_TEMPERATURE = 0.05
"""Temperature of annealing, radii: at three times as much the rotation of the first commands is lost."""


@compiled
def period_costs(
    pulls: np.ndarray,
    forces: np.ndarray,
    thrust: np.ndarray,
    kinds: np.ndarray,
    count: int,
    cosine: np.ndarray,
    sine: np.ndarray,
    price: float,
    period: float,
) -> np.ndarray:
    """Least cost of every period, (N, count, angles), by kind of torque and by angle of rotation so far.

    The cost of a thruster pattern is the price of its thrust less the mean, over the period's two ends, of
    pull . R force, with the best rotation R within that angle of the first attitude; at the last angle any R.

    Args:
        pulls: (N + 1, 3) costates of the velocity in W at the periods' ends.
        forces: (P, 3) of the patterns, N, in W at the first attitude.
        thrust: (P,) N.
        kinds: (P,) kind of torque of each pattern.
        count: number of kinds.
        cosine: (angles,) cosine of each angle; -2 from half a turn on, where every R is allowed.
        sine: (angles,) sine of each angle.
        price: cost of a newton second.
        period: control period, s.
    """
    out = np.full((len(pulls) - 1, count, len(cosine)), np.inf)
    last = len(cosine) - 1
    for k in range(len(pulls) - 1):
        for j in range(len(forces)):
            # Components of the force along and across the pull at both ends.
            f = forces[j]
            size = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
            row = out[k, kinds[j]]
            along = np.zeros(2)
            across = np.zeros(2)
            full = np.zeros(2)
            for end in range(2):
                q = pulls[k + end]
                full[end] = size * math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
                along[end] = q[0] * f[0] + q[1] * f[1] + q[2] * f[2]
                across[end] = math.sqrt(max(0.0, full[end] ** 2 - along[end] ** 2))
            # The best rotation within each angle brings the force as far towards the pull as it may.
            for r in range(len(cosine)):
                gain = 0.0
                for end in range(2):
                    if r == last or along[end] >= full[end] * cosine[r]:
                        gain += full[end]
                    else:
                        gain += along[end] * cosine[r] + across[end] * sine[r]
                row[r] = min(row[r], period * (price * thrust[j] - 0.5 * gain))
    return out


@compiled
def least_costs(
    costs: np.ndarray, moves: np.ndarray, rotated: np.ndarray, states: int, first: int
) -> np.ndarray:
    """Least cost from one state at angle 0 to every state, (states,), by dynamic programming over the periods.

    Args:
        costs: (N, kinds, angles), see `period_costs`.
        moves: (M, 3) from state, to state, kind.
        rotated: (M,) cells of angle by which a move rotates at most; the last cell is for all beyond.
        states: number of states.
        first: index of the first state.
    """
    angles = costs.shape[2]
    value = np.full((states, angles), np.inf)
    value[first, 0] = 0.0
    for k in range(len(costs)):
        new = np.full((states, angles), np.inf)
        for x in range(len(moves)):
            i, j, kind = moves[x]
            for r in range(angles):
                if value[i, r] < np.inf:
                    to = min(r + rotated[x], angles - 1)
                    new[j, to] = min(new[j, to], value[i, r] + costs[k, kind, to])
        value = new
    least = np.empty(states)
    for i in range(states):
        least[i] = value[i].min()
    return least


@compiled
def rotation_quaternion(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Quaternion (w, x, y, z) of a rotation vector, rad."""
    angle = math.sqrt(x * x + y * y + z * z)
    s = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), s * x, s * y, s * z


@compiled
def quaternion_product(
    a: tuple[float, float, float, float], b: tuple[float, float, float, float]
) -> tuple[float, float, float, float]:
    """Product of two quaternions."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@compiled
def rotated_vector(
    q: tuple[float, float, float, float], x: float, y: float, z: float
) -> tuple[float, float, float]:
    """A vector of B in W, by the quaternion q of B in W."""
    w, a, b, c = q
    u = 2.0 * (b * z - c * y)
    v = 2.0 * (c * x - a * z)
    s = 2.0 * (a * y - b * x)
    return x + w * u + b * s - c * v, y + w * v + c * u - a * s, z + w * s + a * v - b * u


@compiled
def integrate_period(
    now: np.ndarray, new: np.ndarray, wrench: np.ndarray, h: float, quadrature: np.ndarray
) -> None:
    """Integrate a state (13,) over h seconds of a steady wrench.

    Attitudes are of fourth order in the period (Magnus), forces are integrated by Gauss-Legendre quadrature:
    accurate to some micrometres.

    Args:
        now: (13,) state at the beginning.
        new: (13,) state at the end, written.
        wrench: (6,) acceleration and angular acceleration on B.
        h: time, s.
        quadrature: (2, nodes) nodes and weights of Gauss-Legendre on (0, 1).
    """
    fx = wrench[0]
    fy = wrench[1]
    fz = wrench[2]
    ax = wrench[3]
    ay = wrench[4]
    az = wrench[5]
    new[:] = now
    q = (now[3], now[4], now[5], now[6])
    w0 = now[10]
    w1 = now[11]
    w2 = now[12]
    # Commutator w x a of the Magnus expansion: the rotation vector after s is s w + s^2/2 a + s^3/12 (w x a).
    cx = w1 * az - w2 * ay
    cy = w2 * ax - w0 * az
    cz = w0 * ay - w1 * ax
    # Velocity, and the position that it adds, by quadrature of the rotating force.
    if fx != 0.0 or fy != 0.0 or fz != 0.0:
        for node in range(quadrature.shape[1]):
            s = quadrature[0, node] * h
            weight = quadrature[1, node] * h
            a = 0.5 * s * s
            b = s * s * s / 12.0
            turn = quaternion_product(
                q,
                rotation_quaternion(
                    s * w0 + a * ax + b * cx, s * w1 + a * ay + b * cy, s * w2 + a * az + b * cz
                ),
            )
            px, py, pz = rotated_vector(turn, fx, fy, fz)
            new[7], new[8], new[9] = (
                new[7] + weight * px,
                new[8] + weight * py,
                new[9] + weight * pz,
            )
            weight *= h - s
            new[0], new[1], new[2] = (
                new[0] + weight * px,
                new[1] + weight * py,
                new[2] + weight * pz,
            )
    # Attitude at the end.
    if w0 != 0.0 or w1 != 0.0 or w2 != 0.0 or ax != 0.0 or ay != 0.0 or az != 0.0:
        a = 0.5 * h * h
        b = h * h * h / 12.0
        turn = rotation_quaternion(
            h * w0 + a * ax + b * cx, h * w1 + a * ay + b * cy, h * w2 + a * az + b * cz
        )
        new[3], new[4], new[5], new[6] = quaternion_product(q, turn)
    # Motion at the first velocity, and the spin.
    new[0], new[1], new[2] = new[0] + h * now[7], new[1] + h * now[8], new[2] + h * now[9]
    new[10] = w0 + h * ax
    new[11] = w1 + h * ay
    new[12] = w2 + h * az
