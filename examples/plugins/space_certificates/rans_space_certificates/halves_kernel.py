"""Enumeration of half flights, compiled: see `halves`."""

from __future__ import annotations

import math

import numpy as np
from rans_bounds.compiled import compiled

from rans_space_certificates.kernel import integrate_period, rotated_vector


@compiled
def gained(
    state: np.ndarray,
    t: float,
    direction: np.ndarray,
    flight: float,
    tolerance: float,
    slope: float,
) -> float:
    """Weighted velocity gained since rest in the origin, m/s: integral of (1 + slope - 2 t / T) a . n.

    Integrated by parts it is (2 p / T + (1 + slope - 2 t / T) v) . n, which coasting does not change.

    Args:
        state: (13,) state at time t, with p and v in W.
        t: time since the half's beginning, s.
        direction: (3,) unit vector; n is the best direction within ``tolerance`` of it.
        flight: time T of both halves, s.
        tolerance: tolerance of the attitude, rad.
        slope: slope of the weight between the halves.
    """
    along = 0.0
    size = 0.0
    for i in range(3):
        x = 2.0 * state[i] / flight + (1.0 + slope - 2.0 * t / flight) * state[7 + i]
        along = along + x * direction[i]
        size = size + x * x
    size = math.sqrt(size)
    return size * math.cos(
        max(0.0, math.acos(min(1.0, max(-1.0, along / max(size, 1e-300)))) - tolerance)
    )


@compiled
def continue_halves(
    states: np.ndarray,
    periods: np.ndarray,
    pulses_left: np.ndarray,
    half: int,
    patterns: np.ndarray,
    sizes: np.ndarray,
    direction: np.ndarray,
    flight: float,
    tolerance: float,
    slope: float,
    h: float,
    quadrature: np.ndarray,
    pulse: float,
    gain_needed: float,
    new_states: np.ndarray,
    new_periods: np.ndarray,
    new_pulses_left: np.ndarray,
) -> int:
    """Continue halves by one pattern of thrusters in every way that can still gain enough.

    Branches are cut off by upper bounds of the gain, from cheap to exact.

    Args:
        states: (n, 13) at the start of a period, see `kernel.integrate_flight`.
        periods: (n,) that period.
        pulses_left: (n,) pulses that each still has to fire.
        half: control periods of a half.
        patterns: (P, 6) acceleration and angular acceleration on B, the smallest patterns first.
        sizes: (P,) pulses of each pattern.
        direction: (3,) unit vector in W, see `gained`.
        flight: time of both halves, s.
        tolerance: rad, see `gained`.
        slope: see `gained`.
        h: control period, s.
        quadrature: (2, nodes) nodes and weights of Gauss-Legendre on (0, 1).
        pulse: speed gained by a pulse, m/s.
        gain_needed: weighted velocity that a half must gain in the end, m/s.
        new_states: (room, 13) new states, written; those without pulses left are flown to the half's end.
        new_periods: (room,) their periods, written.
        new_pulses_left: (room,) pulses that each has left, written.

    Returns:
        Number of new states; -1 if there are more than ``new_states`` has rows.
    """
    count = 0
    now = np.empty(13)
    new = np.empty(13)
    nothing = np.zeros(6)
    for row in range(len(states)):
        now[:] = states[row]
        for k in range(periods[row], half):
            first = 1.0 + slope - 2.0 * k * h / flight
            last = 1.0 + slope - 2.0 * (k + 1) * h / flight
            # Largest weights of a push in this period, and in later ones.
            weight = max(abs(first), abs(slope))
            later_weight = max(abs(last), abs(slope))
            before = gained(now, k * h, direction, flight, tolerance, slope)
            if before + pulses_left[row] * pulse * weight < gain_needed:
                break
            b0, b1, b2 = rotated_vector(
                (now[3], -now[4], -now[5], -now[6]), direction[0], direction[1], direction[2]
            )
            spin = math.sqrt(now[10] ** 2 + now[11] ** 2 + now[12] ** 2)
            for pattern_index in range(len(sizes)):
                remaining_pulses = pulses_left[row] - sizes[pattern_index]
                pattern = patterns[pattern_index]
                if remaining_pulses < 0:
                    break
                # A cheap bound first: within the period the craft rotates by so much at most.
                push = math.sqrt(pattern[0] ** 2 + pattern[1] ** 2 + pattern[2] ** 2)
                turn = tolerance + h * (
                    spin + 0.5 * h * math.sqrt(pattern[3] ** 2 + pattern[4] ** 2 + pattern[5] ** 2)
                )
                angle = math.acos(
                    min(
                        1.0,
                        max(
                            -1.0,
                            (b0 * pattern[0] + b1 * pattern[1] + b2 * pattern[2])
                            / max(push, 1e-300),
                        ),
                    )
                )
                largest_gain = weight * h * push
                if last >= 0.0:
                    largest_gain *= math.cos(min(0.5 * math.pi, max(0.0, angle - turn)))
                if before + largest_gain + remaining_pulses * pulse * later_weight < gain_needed:
                    continue
                integrate_period(now, new, pattern, h, quadrature)
                if (
                    gained(new, (k + 1) * h, direction, flight, tolerance, slope)
                    + remaining_pulses * pulse * later_weight
                    < gain_needed
                ):
                    continue
                if count == len(new_states):
                    return -1
                new_states[count] = new
                new_periods[count] = k + 1
                new_pulses_left[count] = remaining_pulses
                if remaining_pulses == 0 and k + 1 < half:
                    integrate_period(
                        new, new_states[count], nothing, (half - k - 1) * h, quadrature
                    )
                count += 1
            integrate_period(now, new, nothing, h, quadrature)
            now[:] = new
    return count
