"""Compiled loops of certificates in space: dynamic program, rigid-body integration and annealing.

States (13,) are p in W, the quaternion of B in W (w, x, y, z), v in W and the angular velocity in B.
"""

from __future__ import annotations

import math

import numpy as np

from rans.optimal.certificate.compiled import compiled

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
def integrate_flight(
    commands: np.ndarray,
    first: int,
    wrenches: np.ndarray,
    h: float,
    quadrature: np.ndarray,
    path: np.ndarray,
) -> None:
    """Integrate states ``path`` (N + 1, 13) from period ``first`` on, starting from ``path[first]``.

    Attitudes are of fourth order in the period (Magnus), forces are integrated by Gauss-Legendre quadrature:
    accurate to some micrometres, so that solutions are replayed by the engines' equations afterwards.

    Args:
        commands: (N, thrusters) zeros and ones.
        first: period from which on commands differ from those that ``path`` was computed with.
        wrenches: (thrusters, 6) acceleration and angular acceleration on B.
        h: control period, s.
        quadrature: (2, nodes) nodes and weights of Gauss-Legendre on (0, 1).
        path: states, written from index ``first`` + 1 on.
    """
    total = np.empty(6)
    for k in range(first, len(commands)):
        total[:] = 0.0
        for i in range(len(wrenches)):
            if commands[k, i] != 0:
                for c in range(6):
                    total[c] += wrenches[i, c]
        integrate_period(path[k], path[k + 1], total, h, quadrature)


@compiled
def integrate_period(
    now: np.ndarray, new: np.ndarray, wrench: np.ndarray, h: float, quadrature: np.ndarray
) -> None:
    """Integrate a state (13,) over h seconds of a steady wrench; accuracy as in `integrate_flight`.

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


@compiled
def miss(state: np.ndarray, goal: np.ndarray, radii: np.ndarray, quantum: float) -> float:
    """Distance of a state (13,) from the goal set, in radii; 0 within the set.

    It is the sum of what position, velocity and attitude are beyond their radii. Spin beyond its radius adds 5 for
    every quantum: as much as five radii, since only other thrusters could change it.
    """
    position_error = 0.0
    velocity_error = 0.0
    spin_error = 0.0
    cosine = 0.0
    for i in range(3):
        position_error += (state[i] - goal[i]) ** 2
        velocity_error += (state[7 + i] - goal[7 + i]) ** 2
        spin_error += (state[10 + i] - goal[10 + i]) ** 2
    for i in range(4):
        cosine += state[3 + i] * goal[3 + i]
    angle = 2.0 * math.acos(min(1.0, abs(cosine)))
    spin_error = math.sqrt(spin_error)
    total = (
        max(0.0, math.sqrt(position_error) / radii[0] - 1.0)
        + max(0.0, math.sqrt(velocity_error) / radii[1] - 1.0)
        + max(0.0, angle / radii[2] - 1.0)
    )
    return total if spin_error <= radii[3] else total + 5.0 * spin_error / quantum


@compiled
def anneal(
    commands: np.ndarray,
    wrenches: np.ndarray,
    torque_pairs: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    radii: np.ndarray,
    quantum: float,
    h: float,
    quadrature: np.ndarray,
    attempts: int,
    random: np.random.Generator,
) -> float:
    """Change commands until the flight ends in the goal set, by simulated annealing at a constant temperature.

    The temperature is low, so that the first commands must already rotate the craft as needed. A change toggles two
    thrusters whose torques cancel, in the same period, up to three periods apart, or anywhere; or, in 3 % of
    attempts, a single thruster.

    Args:
        commands: (N, thrusters) zeros and ones; overwritten by the best.
        wrenches: (thrusters, 6) acceleration and angular acceleration on B.
        torque_pairs: (thrusters, thrusters): 1 where torques are the same, -1 where opposite, else 0.
        start: (13,) initial state.
        goal: (13,) goal state.
        radii: (4,) of position, velocity, attitude and spin.
        quantum: of spin, rad/s.
        h: control period, s.
        quadrature: (2, nodes) nodes and weights of Gauss-Legendre on (0, 1).
        attempts: changes that are tried at most.
        random: generator.

    Returns:
        Distance of the best commands' end from the goal set, see `miss`.
    """
    steps, count = commands.shape
    path = np.zeros((steps + 1, 13))
    trial = np.zeros((steps + 1, 13))
    best_commands = commands.copy()
    path[0] = start
    integrate_flight(commands, 0, wrenches, h, quadrature, path)
    best_miss = current_miss = miss(path[steps], goal, radii, quantum)
    for _ in range(attempts):
        if best_miss <= 0.0:
            break
        # Draw a thruster and period to toggle, and a second to toggle with it.
        period = int(steps * random.random())
        thruster = int(count * random.random())
        kind = random.random()
        second_period = period
        second_thruster = thruster if random.random() < 0.3 else int(count * random.random())
        if kind > 0.45:
            second_period = (
                period - 3 + int(7.0 * random.random())
                if kind < 0.8
                else int(steps * random.random())
            )
        single = kind > 0.97
        if (
            second_period < 0
            or second_period >= steps
            or (second_period == period and second_thruster == thruster)
        ):
            continue
        change_first = 1 - 2 * commands[period, thruster]
        change_second = 1 - 2 * commands[second_period, second_thruster]
        if not single and torque_pairs[thruster, second_thruster] != -change_first * change_second:
            continue
        # Fly the changed commands, from the first change on.
        commands[period, thruster] += change_first
        if not single:
            commands[second_period, second_thruster] += change_second
        first = period if single else min(period, second_period)
        trial[first] = path[first]
        integrate_flight(commands, first, wrenches, h, quadrature, trial)
        trial_miss = miss(trial[steps], goal, radii, quantum)
        # Accept or undo.
        if trial_miss <= current_miss or random.random() < math.exp(
            (current_miss - trial_miss) / _TEMPERATURE
        ):
            current_miss = trial_miss
            path[first:] = trial[first:]
            if current_miss < best_miss:
                best_miss = current_miss
                best_commands[:] = commands
        else:
            commands[period, thruster] -= change_first
            if not single:
                commands[second_period, second_thruster] -= change_second
    commands[:] = best_commands
    return best_miss
