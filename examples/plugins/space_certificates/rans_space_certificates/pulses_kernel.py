"""Search for few pulses in space, compiled: thrusters by simulated annealing, instants by least squares.

A few pulses in a long flight are hard to find by single changes, since moving a pulse by a period rotates
all that follows. So pulses are first taken for impulses at any instant: the final error of a flight with given
thrusters is then a smooth function of the instants, which Levenberg and Marquardt bring to zero in some
microseconds where that is possible (`impulses_kernel`). Annealing changes thrusters and restarts instants. Flights
that come near the goal are rounded to whole periods.
"""

from __future__ import annotations

import math

import numpy as np

from rans.optimal.certificate.compiled import compiled
from rans_space_certificates.impulses_kernel import pulse_order, refined
from rans_space_certificates.kernel import integrate_period, miss

_NEAR = 0.5
"""Root of the sum of squared errors, in radii, below which rounding is tried: it moves errors by about as much."""
_ROUNDINGS = 3000
"""Changes that annealing tries in a rounding."""


@compiled
def final_state(
    periods: np.ndarray,
    thrusters: np.ndarray,
    steps: int,
    wrenches: np.ndarray,
    start: np.ndarray,
    h: float,
    quadrature: np.ndarray,
    order: np.ndarray,
    path: np.ndarray,
) -> np.ndarray:
    """Final state (13,) of a flight whose thrusters fire for single periods, see `kernel.integrate_flight`.

    Args:
        periods: (K,) period of each pulse.
        thrusters: (K,) thruster of each pulse.
        steps: control periods.
        wrenches: (thrusters, 6) acceleration and angular acceleration on B.
        start: (13,) initial state.
        h: control period, s.
        quadrature: (2, nodes) nodes and weights of Gauss-Legendre on (0, 1).
        order: (K,) scratch memory.
        path: (2, 13) scratch memory; its last written row is returned.
    """
    pulse_order(periods, order)
    path[0] = start
    period = 0
    pulse = 0
    row = 0
    wrench = np.zeros(6)
    while True:
        next_period = periods[order[pulse]] if pulse < len(order) else steps
        # Coast to the next pulse, or to the end.
        if next_period > period:
            wrench[:] = 0.0
            integrate_period(
                path[row], path[1 - row], wrench, (next_period - period) * h, quadrature
            )
            row = 1 - row
        if pulse == len(order):
            return path[row]
        # Fire all pulses of this period.
        wrench[:] = 0.0
        while pulse < len(order) and periods[order[pulse]] == next_period:
            for c in range(6):
                wrench[c] += wrenches[thrusters[order[pulse]], c]
            pulse += 1
        integrate_period(path[row], path[1 - row], wrench, h, quadrature)
        row = 1 - row
        period = next_period + 1


@compiled
def _opens_twice(periods: np.ndarray, thrusters: np.ndarray) -> bool:
    """Whether a thruster would have to open twice in a period."""
    for a in range(len(periods)):
        for b in range(a):
            if periods[a] == periods[b] and thrusters[a] == thrusters[b]:
                return True
    return False


@compiled
def rounded_pulses(
    instants: np.ndarray,
    thrusters: np.ndarray,
    steps: int,
    wrenches: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    radii: np.ndarray,
    quantum: float,
    h: float,
    quadrature: np.ndarray,
    random: np.random.Generator,
    best_periods: np.ndarray,
) -> float:
    """Round impulses' instants to whole periods so that the flight ends as near the goal set as possible.

    Annealing moves one to three pulses by a period at a time, its temperature falling from 0.5 to 0.05 radii.

    Args:
        instants: (K,) instants of the impulses, s.
        thrusters: (K,) thruster of each.
        steps: control periods.
        wrenches: (thrusters, 6) acceleration and angular acceleration on B.
        start: (13,) initial state, see `kernel.integrate_flight`.
        goal: (13,) goal state.
        radii: (4,) of position, velocity, attitude and spin.
        quantum: of spin, rad/s.
        h: control period, s.
        quadrature: (2, nodes) nodes and weights of Gauss-Legendre on (0, 1).
        random: generator.
        best_periods: (K,) periods, written.

    Returns:
        Error of the result, see `kernel.miss`: 0 within the goal set.
    """
    count = len(thrusters)
    order = np.empty(count, np.int64)
    path = np.empty((2, 13))
    periods = np.empty(count, np.int64)
    for j in range(count):
        periods[j] = min(steps - 1, max(0, round(instants[j] / h - 0.5)))
    trial = periods.copy()
    current_miss = 1e9
    best_miss = 1e9
    for attempt in range(_ROUNDINGS):
        if not _opens_twice(trial, thrusters):
            state = final_state(
                trial, thrusters, steps, wrenches, start, h, quadrature, order, path
            )
            trial_miss = miss(state, goal, radii, quantum)
            temperature = 0.5 * 0.1 ** (attempt / _ROUNDINGS)
            if trial_miss <= current_miss or random.random() < math.exp(
                (current_miss - trial_miss) / temperature
            ):
                current_miss = trial_miss
                periods[:] = trial
                if current_miss < best_miss:
                    best_miss = current_miss
                    best_periods[:] = periods
                    if best_miss <= 0.0:
                        break
        # Move one to three pulses by a period.
        trial[:] = periods
        for _ in range(1 + int(3.0 * random.random())):
            j = int(count * random.random())
            trial[j] = min(steps - 1, max(0, trial[j] + (1 if random.random() < 0.5 else -1)))
    return best_miss


@compiled
def _change_flight(
    instants: np.ndarray,
    thrusters: np.ndarray,
    products: np.ndarray,
    flight: float,
    random: np.random.Generator,
) -> bool:
    """Change a flight (K,) in place, keeping its number of pulses and nearly always its final spin.

    With probability 0.3 a thruster is replaced by another of the same torque, with 0.2 two pulses swap
    thrusters, with 0.3 a pair of opposite torques is replaced by another pair, with 0.18 a pulse moves to any
    instant, and with 0.02 a thruster is replaced by any other.

    Returns:
        Whether the flight changed; false where the drawn change is not allowed.
    """
    count = len(thrusters)
    thruster_count = len(products)
    kind = random.random()
    a = int(count * random.random())
    b = int(count * random.random())
    i = int(thruster_count * random.random())
    j = int(thruster_count * random.random())
    # Another thruster for a pulse, whose torque is the same.
    if kind < 0.3:
        if (
            thrusters[a] == i
            or products[thrusters[a], thrusters[a]] + products[i, i]
            != 2 * products[thrusters[a], i]
        ):
            return False
        thrusters[a] = i
    elif kind < 0.5:
        # Two pulses exchange their thrusters.
        if thrusters[a] == thrusters[b]:
            return False
        thrusters[a], thrusters[b] = thrusters[b], thrusters[a]
    elif kind < 0.8:
        if (
            a == b
            or not _has_opposite_torque(products, thrusters[a], thrusters[b])
            or not _has_opposite_torque(products, i, j)
        ):
            return False
        thrusters[a] = i
        thrusters[b] = j
        if random.random() < 0.3:
            instants[a] = instants[b] = flight * random.random()
    elif kind < 0.98:
        # Another instant for a pulse.
        instants[a] = flight * random.random()
    else:
        thrusters[a] = i
    return True


@compiled
def _has_opposite_torque(products: np.ndarray, i: int, j: int) -> bool:
    """Whether torques of two thrusters cancel, |t_i + t_j|^2 = 0, by their inner products in squared quanta."""
    return products[i, i] + products[j, j] == -2 * products[i, j]


@compiled
def search_pulses(
    instants: np.ndarray,
    thrusters: np.ndarray,
    steps: int,
    wrenches: np.ndarray,
    products: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    radii: np.ndarray,
    inner: np.ndarray,
    quantum: float,
    h: float,
    quadrature: np.ndarray,
    attempts: int,
    random: np.random.Generator,
    best_periods: np.ndarray,
    best_thrusters: np.ndarray,
) -> float:
    """Search for K pulses that end in the goal set, starting from a first guess.

    The temperature of annealing falls from 0.8 to 0.08 radii; its cost is the error that least squares leave,
    where a quantum of wrong spin counts as 5 radii. See the module.

    Args:
        instants: (K,) instants of the guess, s, overwritten.
        thrusters: (K,) thrusters of the guess, overwritten.
        steps: control periods.
        wrenches: (thrusters, 6) acceleration and angular acceleration on B.
        products: (thrusters, thrusters) inner products of torques, in squared quanta.
        start: (13,) initial state, see `kernel.integrate_flight`.
        goal: (13,) goal state.
        radii: (4,) of position, velocity, attitude and spin.
        inner: (3,) of the first three, smaller by what rounding to periods may move.
        quantum: of spin, rad/s.
        h: control period, s.
        quadrature: (2, nodes) nodes and weights of Gauss-Legendre on (0, 1).
        attempts: changes that annealing tries.
        random: generator.
        best_periods: (K,) periods of the best pulses, written.
        best_thrusters: (K,) their thrusters, written.

    Returns:
        Error of the best pulses, see `kernel.miss`: 0 within the goal set.
    """
    flight = steps * h
    best_miss = 1e9
    current_miss = 1e9
    spin = np.empty(3)
    trial = instants.copy()
    trial_thrusters = thrusters.copy()
    trial_periods = np.empty(len(instants), np.int64)
    for attempt in range(attempts):
        if attempt > 0:
            trial[:] = instants
            trial_thrusters[:] = thrusters
            if not _change_flight(trial, trial_thrusters, products, flight, random):
                continue
        # Cost: what least squares leave, and the spin that no instant can change.
        for c in range(3):
            spin[c] = start[10 + c] - goal[10 + c]
            for j in trial_thrusters:
                spin[c] += h * wrenches[j, 3 + c]
        spin_error = math.sqrt(spin[0] ** 2 + spin[1] ** 2 + spin[2] ** 2)
        trial_miss = refined(trial, trial_thrusters, flight, wrenches, start, goal, h, inner)
        trial_miss += 5.0 * spin_error / quantum if spin_error > radii[3] else 0.0
        temperature = 0.8 * 0.1 ** (attempt / attempts)
        if trial_miss <= current_miss or random.random() < math.exp(
            (current_miss - trial_miss) / temperature
        ):
            current_miss = trial_miss
            instants[:] = trial
            thrusters[:] = trial_thrusters
            # Near the goal set: round to whole periods.
            if current_miss < _NEAR:
                rounded_miss = rounded_pulses(
                    instants,
                    thrusters,
                    steps,
                    wrenches,
                    start,
                    goal,
                    radii,
                    quantum,
                    h,
                    quadrature,
                    random,
                    trial_periods,
                )
                if rounded_miss < best_miss:
                    best_miss = rounded_miss
                    best_periods[:] = trial_periods
                    best_thrusters[:] = thrusters
                    if best_miss <= 0.0:
                        break
    return best_miss
