"""One Kalman filter: covariances against SciPy's Riccati equation, thrust of a period, rotations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from rans import GoToPose
from rans.episode.scenario import scenarios
from rans.model.fields import Heading, Quat
from rans.tasks.base import Task, observation
from rans.tasks.derived import layout
from tests.support.engines import FLYER, PLATFORM
from tests.support.filter_flights import COUNT, SEED, TIMING, in_body, made


@pytest.mark.parametrize(("drift", "response"), [(1e-3, 0.0), (1.0, 0.0), (1e-3, 1.0), (0.03, 1.0)])
def test_covariances_become_those_of_scipy(drift, response):
    """SciPy solves the algebraic Riccati equation of a pose and its velocity, read with equal noise.

    With steady accelerations the state has one too, which no sensor reads.
    """
    task = GoToPose()
    t = TIMING.control_period
    body = layout(task, 2).body
    filters = made(PLATFORM, task, drift, response)
    read = in_body(PLATFORM, task, observation(task, *_example(task)))
    memory = [np.zeros(COUNT)] * filters.width(body)
    shut = (np.zeros(COUNT),) * len(PLATFORM.thrusters)
    for _ in range(400):  # 80 s: what is left of the beginning is rounding
        memory = filters.next_memory(body, read, memory, shut)
    size = 3 if response else 2
    places = np.triu_indices(size)
    found = [float(x[0]) for x in memory[body.width + filters.axes :][: len(places[0])]]
    moves = np.array([[1.0, t, 0.5 * t * t], [0.0, 1.0, t], [0.0, 0.0, 1.0]])[:size, :size]
    noise = np.diag([drift * (0.5 * t) ** 2, drift, drift])[:size, :size]
    told = np.eye(size)[:2]
    known: Any = solve_discrete_are(moves.T, told.T, noise, np.eye(2))
    np.testing.assert_allclose(found, known[places], rtol=1e-6)


def _example(task: Task) -> Any:
    chosen = scenarios(task, PLATFORM, SEED, COUNT)
    return chosen.start, chosen.goal


@pytest.mark.parametrize(("craft", "drift"), [(PLATFORM, 1e-3), (FLYER, 1.0)])
def test_a_rotation_stays_one(drift, craft):
    """In single precision, over three hundred turns in tumbling flight: rounding once doubled with each."""
    task = GoToPose()
    random = np.random.default_rng(2)
    body = layout(task, craft.dimension).body
    filters = made(craft, task, drift)
    turn = random.random((4, COUNT), np.float32) - np.float32(0.5)
    attitude = (
        Heading(6.0 * turn[0]) if craft.dimension == 2 else Quat(*turn).normalised()
    ).columns()
    size = len(attitude)
    width = craft.dimension
    spins = [3.0 * (random.random(COUNT, np.float32) - 0.5) for _ in filters.twist[0]]
    still = np.zeros(COUNT, np.float32)
    read = [*[still] * width, *spins, still, *[still] * width, *attitude]
    read += [still] * (body.width - len(read))
    place = 2 * width + len(spins) + 1
    memory = [still] * filters.width(body)
    for _ in range(300):
        memory = filters.next_memory(body, read, memory, [still] * len(craft.thrusters))
        # It goes on turning as fast, and is seen where it is expected.
        read = [*read[:place], *memory[place : place + size], *read[place + size :]]
    rotation = np.reshape(memory[place : place + size], (-1, width, COUNT))
    assert rotation.dtype == np.float32
    inner = np.einsum("ain,bin->nab", rotation, rotation)
    one = np.broadcast_to(np.eye(len(rotation)), inner.shape)
    np.testing.assert_allclose(inner, one, rtol=0, atol=3e-6)  # some roundings of single precision
