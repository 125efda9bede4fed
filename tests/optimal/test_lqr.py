"""The LQR settles from everywhere, on every kind of spacecraft."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rans.evaluation.metrics import final_errors, settling_times
from rans.fields import map_leaves
from rans.flight import fly, scenarios
from rans.optimal.lqr import LQR, _gains
from rans.scenario import Scenario
from rans.spacecraft import Spacecraft
from rans.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose
from rans.timing import Timing
from tests.crafts import nasty_spatial

TASK = GoToPose(spawn_distance=(3.0, 4.0))


@pytest.mark.parametrize("name", ["floating-platform", "free-flyer"])
def test_settles_from_every_start(name: str) -> None:
    """The bounds are the facts of a published baseline of this kind, 6.8 s and 1 cm, with a margin."""
    craft, timing = load_spacecraft(name), Timing()
    flight = fly(craft, TASK, LQR(craft, timing), scenarios(TASK, craft, 21, 50), timing)
    settled = settling_times(flight)
    assert np.isfinite(settled).all()
    assert np.median(settled) < 8.0
    assert final_errors(flight)["position"].mean() < 0.01


@pytest.mark.parametrize("craft", [
    replace(load_spacecraft("floating-platform"), thrust_sharing="split"), nasty_spatial(),
], ids=lambda craft: craft.name)
def test_brings_awkward_spacecraft_home(craft: Spacecraft) -> None:
    """A shared supply and an off-centre asymmetric body: slower and rougher, but there in the end."""
    timing = Timing(episode_steps=250)
    flight = fly(craft, TASK, LQR(craft, timing), scenarios(TASK, craft, 22, 20), timing)
    errors = final_errors(flight)
    assert errors["position"].max() < 0.10
    assert errors["attitude"].max() < math.radians(10.0)


def test_batch_equals_loop() -> None:
    craft, timing = load_spacecraft("floating-platform"), Timing(episode_steps=40)
    starts = scenarios(TASK, craft, 23, 3)
    together = fly(craft, TASK, LQR(craft, timing), starts, timing).commands
    for k in range(3):
        one = Scenario(*(map_leaves(lambda x, k=k: x[k:k + 1], s) for s in (starts.start, starts.goal)))
        alone = fly(craft, TASK, LQR(craft, timing), one, timing).commands
        assert np.array_equal(alone[:, 0], together[:, k])


def test_gains_stabilise_and_tend_to_the_continuous_optimum() -> None:
    """For p'' = u with weights q on p, r on p' and 1 / b^2 on u the continuous optimum is k = b sqrt(q)
    and d = sqrt(2 k + b^2 r) (Anderson and Moore, "Optimal Control", 1990, chapter 3)."""
    deviation, acceleration = 0.5, 0.3
    stiffness, damping = _gains(1e-4, deviation, acceleration)
    assert stiffness == pytest.approx(0.6, rel=1e-3)  # 0.3 / 0.5, and first order in the period
    assert damping == pytest.approx(math.sqrt(1.2 + 0.6), rel=1e-3)
    stiffness, damping = _gains(0.2, deviation, acceleration)
    closed = np.array([[1.0, 0.2], [0.0, 1.0]]) - np.outer([0.02, 0.2], [stiffness, damping])
    assert np.abs(np.linalg.eigvals(closed)).max() < 1.0
