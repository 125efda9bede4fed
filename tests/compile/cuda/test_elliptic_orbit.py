"""Kernel of a mission on an elliptic orbit against NumPy: each craft has its own place on the orbit."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from rans.fast.engine import Engine
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.tasks import Dock, TargetOrbit
from tests.support.host_kernels import SEED, compare, needs_compiler

pytestmark = needs_compiler


@pytest.mark.slow
def test_an_ellipse_steps_and_restarts_as_on_numpy(on_host: Any) -> None:
    task = Dock(orbit=TargetOrbit(eccentricity=0.5, semi_major_axis_km=13_556.0))
    made: Any = (
        load_spacecraft("afrl-deputy"),
        task,
        8,
        Timing(control_period=10.0, episode_steps=3, checks=1),
    )
    how: Any = {"seed": SEED, "dtype": torch.float64}
    ours = Engine(*made, **how)
    # Anomalies are those of eight places, and move on.
    anomalies = ours.episode.goal.notes[3].copy()
    assert len(set(anomalies.tolist())) == 8
    commands = torch.rand((5, 8, 6), generator=torch.Generator().manual_seed(1))
    assert compare(ours, on_host(*made, **how), form=torch.float32, given=commands) == 8
    assert (ours.episode.goal.notes[3] != anomalies).all()
