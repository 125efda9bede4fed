"""The loop over all halves of flights, compiled: see `halves`."""

from __future__ import annotations

import math

import numpy as np

from rans.optimal.certificate.compiled import compiled
from rans.optimal.certificate.space.kernel import rotated, step


@compiled
def gained(
    state: np.ndarray, t: float, ahead: np.ndarray, flight: float, tilt: float, lean: float
) -> float:
    """Integral of (1 + lean - 2 t / T) times the acceleration ahead, m/s, from rest in the origin.

    It is 2 p / T + (1 + lean - 2 t / T) v, which coasting keeps. Ahead is the best direction within ``tilt``,
    rad, of the vector (3,) given.
    """
    along = 0.0
    size = 0.0
    for i in range(3):
        x = 2.0 * state[i] / flight + (1.0 + lean - 2.0 * t / flight) * state[7 + i]
        along = along + x * ahead[i]
        size = size + x * x
    size = math.sqrt(size)
    return size * math.cos(
        max(0.0, math.acos(min(1.0, max(-1.0, along / max(size, 1e-300)))) - tilt)
    )


@compiled
def followed(
    states: np.ndarray,
    periods: np.ndarray,
    left: np.ndarray,
    half: int,
    patterns: np.ndarray,
    sizes: np.ndarray,
    ahead: np.ndarray,
    flight: float,
    tilt: float,
    lean: float,
    h: float,
    rule: np.ndarray,
    pulse: float,
    least: float,
    result: np.ndarray,
    found_periods: np.ndarray,
    found_left: np.ndarray,
) -> int:
    """Every way to go on by one pattern that can still gain enough; how many, -1 if there is no room for all.

    Args:
        states: (n, 13) at the start of a period, see `spatial_kernel.fly`.
        periods: (n,) that period.
        left: (n,) pulses that are left.
        half: periods of this half.
        patterns: (P, 6) acceleration and angular acceleration on B, the smallest patterns first.
        sizes: (P,) pulses of each.
        ahead: (3,) in W.
        flight: time of both halves, s.
        tilt: rad, see `gained`.
        lean: see `gained`.
        h: control period, s.
        rule: (2, nodes) places and weights on (0, 1).
        pulse: speed gained by a pulse, m/s.
        least: what must be gained in the end, m/s.
        result: (room, 13), written; who has no pulses left is flown to the end of the half.
        found_periods: (room,), written.
        found_left: (room,), written.
    """
    count = 0
    now = np.empty(13)
    new = np.empty(13)
    nothing = np.zeros(6)
    for x in range(len(states)):
        now[:] = states[x]
        for k in range(periods[x], half):
            first = 1.0 + lean - 2.0 * k * h / flight
            last = 1.0 + lean - 2.0 * (k + 1) * h / flight
            # at most, from now on
            worth = max(abs(first), abs(lean))
            later = max(abs(last), abs(lean))
            before = gained(now, k * h, ahead, flight, tilt, lean)
            if before + left[x] * pulse * worth < least:
                break
            b0, b1, b2 = rotated((now[3], -now[4], -now[5], -now[6]), ahead[0], ahead[1], ahead[2])
            spin = math.sqrt(now[10] ** 2 + now[11] ** 2 + now[12] ** 2)
            for s in range(len(sizes)):
                rest = left[x] - sizes[s]
                a = patterns[s]
                if rest < 0:
                    break
                # a cheap bound first: the period turns by so much at most
                push = math.sqrt(a[0] ** 2 + a[1] ** 2 + a[2] ** 2)
                turn = tilt + h * (spin + 0.5 * h * math.sqrt(a[3] ** 2 + a[4] ** 2 + a[5] ** 2))
                off = math.acos(
                    min(1.0, max(-1.0, (b0 * a[0] + b1 * a[1] + b2 * a[2]) / max(push, 1e-300)))
                )
                most = worth * h * push
                if last >= 0.0:
                    most *= math.cos(min(0.5 * math.pi, max(0.0, off - turn)))
                if before + most + rest * pulse * later < least:
                    continue
                step(now, new, a, h, rule)
                if (
                    gained(new, (k + 1) * h, ahead, flight, tilt, lean) + rest * pulse * later
                    < least
                ):
                    continue
                if count == len(result):
                    return -1
                result[count] = new
                found_periods[count] = k + 1
                found_left[count] = rest
                if rest == 0 and k + 1 < half:
                    step(new, result[count], nothing, (half - k - 1) * h, rule)
                count += 1
            step(now, new, nothing, h, rule)
            now[:] = new
    return count
