"""Loops of the bound and of the search in space, compiled: the only ones that cost time."""

from __future__ import annotations

import math

import numpy as np

from rans.optimal.certificate.compiled import compiled

_HEAT = 0.05
"""Temperature of annealing, radii: at three times as much the turn of the first commands is lost."""


@compiled
def stages(
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
    """Least cost of every period, (N, count, angles), by kind of torque and by the angle turned.

    A pattern's cost is its thrust's price less the mean, over the period's two ends, of pull . R force, with
    the best R within the angle of the first attitude; at the last angle any R.

    Args:
        pulls: (N + 1, 3) in W.
        forces: (P, 3) of the patterns, N, in W at the first attitude.
        thrust: (P,) N.
        kinds: (P,) their kinds.
        count: of kinds.
        cosine: (angles,) of the angles turned; -2 from half a turn on.
        sine: (angles,) of them.
        price: of a newton second.
        period: s.
    """
    out = np.full((len(pulls) - 1, count, len(cosine)), np.inf)
    last = len(cosine) - 1
    for k in range(len(pulls) - 1):
        for j in range(len(forces)):
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
def sweep(
    costs: np.ndarray, moves: np.ndarray, turned: np.ndarray, states: int, first: int
) -> np.ndarray:
    """Least cost from a first state at angle 0 to every state, (states,).

    Args:
        costs: (N, kinds, angles), see `stages`.
        moves: (M, 3) from state, to state, kind.
        turned: (M,) cells of the angle that a move turns at most; the last cell is for all beyond.
        states: how many there are.
        first: the first one.
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
                    to = min(r + turned[x], angles - 1)
                    new[j, to] = min(new[j, to], value[i, r] + costs[k, kind, to])
        value = new
    least = np.empty(states)
    for i in range(states):
        least[i] = value[i].min()
    return least


@compiled
def exponential(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Quaternion of a rotation vector."""
    angle = math.sqrt(x * x + y * y + z * z)
    s = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), s * x, s * y, s * z


@compiled
def product(
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
def rotated(
    q: tuple[float, float, float, float], x: float, y: float, z: float
) -> tuple[float, float, float]:
    """A vector on B in the world, q from B to W."""
    w, a, b, c = q
    u = 2.0 * (b * z - c * y)
    v = 2.0 * (c * x - a * z)
    s = 2.0 * (a * y - b * x)
    return x + w * u + b * s - c * v, y + w * v + c * u - a * s, z + w * s + a * v - b * u


@compiled
def fly(
    commands: np.ndarray,
    first: int,
    wrenches: np.ndarray,
    h: float,
    rule: np.ndarray,
    path: np.ndarray,
) -> None:
    """States from a period on, ``path`` (N + 1, 13): p, quaternion, v, w in B, of which [first] is given.

    Attitudes are of order four in the period (Magnus), the force is integrated by Gauss-Legendre: good to
    some micrometres, so that what is found is replayed by the engines' equations.

    Args:
        commands: (N, thrusters) zeros and ones.
        first: the period.
        wrenches: (thrusters, 6) acceleration and angular acceleration on B.
        h: control period, s.
        rule: (2, nodes) places and weights on (0, 1).
        path: written.
    """
    total = np.empty(6)
    for k in range(first, len(commands)):
        total[:] = 0.0
        for i in range(len(wrenches)):
            if commands[k, i] != 0:
                for c in range(6):
                    total[c] += wrenches[i, c]
        step(path[k], path[k + 1], total, h, rule)


@compiled
def step(now: np.ndarray, new: np.ndarray, wrench: np.ndarray, h: float, rule: np.ndarray) -> None:
    """The state (13,) after h seconds of a steady wrench (6,), written; see `fly`."""
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
    cx = w1 * az - w2 * ay
    cy = w2 * ax - w0 * az
    cz = w0 * ay - w1 * ax
    if fx != 0.0 or fy != 0.0 or fz != 0.0:
        for node in range(rule.shape[1]):
            s = rule[0, node] * h
            weight = rule[1, node] * h
            a = 0.5 * s * s
            b = s * s * s / 12.0
            turn = product(
                q,
                exponential(
                    s * w0 + a * ax + b * cx, s * w1 + a * ay + b * cy, s * w2 + a * az + b * cz
                ),
            )
            px, py, pz = rotated(turn, fx, fy, fz)
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
    if w0 != 0.0 or w1 != 0.0 or w2 != 0.0 or ax != 0.0 or ay != 0.0 or az != 0.0:
        a = 0.5 * h * h
        b = h * h * h / 12.0
        turn = exponential(
            h * w0 + a * ax + b * cx, h * w1 + a * ay + b * cy, h * w2 + a * az + b * cz
        )
        new[3], new[4], new[5], new[6] = product(q, turn)
    new[0], new[1], new[2] = new[0] + h * now[7], new[1] + h * now[8], new[2] + h * now[9]
    new[10] = w0 + h * ax
    new[11] = w1 + h * ay
    new[12] = w2 + h * az


@compiled
def miss(state: np.ndarray, goal: np.ndarray, radii: np.ndarray, quantum: float) -> float:
    """Error of a state in radii of position, velocity and attitude; a quantum of spin counts as 5."""
    far = 0.0
    fast = 0.0
    spin = 0.0
    same = 0.0
    for i in range(3):
        far += (state[i] - goal[i]) ** 2
        fast += (state[7 + i] - goal[7 + i]) ** 2
        spin += (state[10 + i] - goal[10 + i]) ** 2
    for i in range(4):
        same += state[3 + i] * goal[3 + i]
    angle = 2.0 * math.acos(min(1.0, abs(same)))
    spin = math.sqrt(spin)
    miss = (
        max(0.0, math.sqrt(far) / radii[0] - 1.0)
        + max(0.0, math.sqrt(fast) / radii[1] - 1.0)
        + max(0.0, angle / radii[2] - 1.0)
    )
    return miss if spin <= radii[3] else miss + 5.0 * spin / quantum


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
    rule: np.ndarray,
    tries: int,
    random: np.random.Generator,
) -> float:
    """Change commands (N, thrusters) until they end in the goal set.

    Simulated annealing at one temperature, so that the first commands should turn as they must. A change
    opens or shuts two thrusters, mostly so that their torques cancel: at once, a little later or anywhere; or
    one. Mates, (thrusters, thrusters), are 1 where torques are the same, -1 where opposite, 0 else. What is
    left in ``commands`` is the best; returned is its miss, 0 within the set.
    """
    steps, count = commands.shape
    path = np.zeros((steps + 1, 13))
    new = np.zeros((steps + 1, 13))
    best_commands = commands.copy()
    path[0] = start
    fly(commands, 0, wrenches, h, rule, path)
    best = value = miss(path[steps], goal, radii, quantum)
    for _ in range(tries):
        if best <= 0.0:
            break
        # which thruster, and which with it
        k = int(steps * random.random())
        i = int(count * random.random())
        kind = random.random()
        k2 = k
        i2 = i if random.random() < 0.3 else int(count * random.random())
        if kind > 0.45:
            k2 = k - 3 + int(7.0 * random.random()) if kind < 0.8 else int(steps * random.random())
        single = kind > 0.97
        if k2 < 0 or k2 >= steps or (k2 == k and i2 == i):
            continue
        change = 1 - 2 * commands[k, i]
        change2 = 1 - 2 * commands[k2, i2]
        if not single and torque_pairs[i, i2] != -change * change2:
            continue
        # what comes of it
        commands[k, i] += change
        if not single:
            commands[k2, i2] += change2
        first = k if single else min(k, k2)
        new[first] = path[first]
        fly(commands, first, wrenches, h, rule, new)
        changed = miss(new[steps], goal, radii, quantum)
        if changed <= value or random.random() < math.exp((value - changed) / _HEAT):
            value = changed
            path[first:] = new[first:]
            if value < best:
                best = value
                best_commands[:] = commands
        else:
            commands[k, i] -= change
            if not single:
                commands[k2, i2] -= change2
    commands[:] = best_commands
    return best
