"""What the motions of every orbit have in common."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from rans_missions.orbits.elliptic import EllipticOrbit
from rans_missions.orbits.perturbed import PerturbedOrbit

from rans.model.fields import Vec3, leaves

N = 0.001027
"""rad/s, a low orbit."""
ELLIPTIC, PERTURBED = EllipticOrbit(N, 0.4, 1.3), PerturbedOrbit.around_earth(N, 0.9, 1e-6, 1.3)
P, V = Vec3(50.0, -100.0, 20.0), Vec3(0.05, 0.1, -0.02)


@pytest.mark.parametrize(
    ("drift", "close", "felt"),
    # To the second order of oblateness: (k n t)^2 is 2e-6, of some 200 m.
    [(ELLIPTIC, 1e-8, 1.0), (PERTURBED, 1e-3, 0.02)],
    ids=["elliptic", "perturbed"],
)
def test_motions_follow_one_another(drift, close, felt):
    """In two parts, the second of which begins later in the orbit; and it is felt where a motion begins."""
    whole, first = (leaves(drift.carry(P, V, time)) for time in (900.0, 500.0))
    there = Vec3(*first[:3]), Vec3(*first[3:])
    parts, same = (leaves(one.carry(*there, 400.0)) for one in (drift.later(500.0), drift))
    assert np.abs(np.subtract(parts, whole)).max() < close
    assert np.abs(np.subtract(same, whole)).max() > felt


@pytest.mark.parametrize(
    "drift", [EllipticOrbit(N, 0.1, 1.3), EllipticOrbit(N, 0.7, 1.3), PERTURBED]
)
def test_single_precision_keeps_the_digits_of_short_times(drift):
    """The way in 0.1 s of a craft at 500 m is 1 cm: its error is that of the position's last digit."""
    numbers = torch.tensor([500.0, -300.0, 200.0, 0.1, -0.05, 0.02], dtype=torch.float32)
    results = []
    for dtype in (torch.float32, torch.float64):
        fields = numbers.to(dtype)[:, None]
        there = replace(drift, angle=torch.full((1,), 1.3, dtype=dtype))
        p, v = there.carry(Vec3(*fields[:3]), Vec3(*fields[3:]), 0.1)
        assert p.x.dtype == dtype
        results.append(np.array([float(x) for x in (*leaves(p), *leaves(v))]))
    error = np.abs(results[0] - results[1])
    assert (error[:3] < 1e-4).all()
    # n p is 0.5 m/s, of which single precision has 1e-7.
    assert (error[3:] < 1e-6).all()
