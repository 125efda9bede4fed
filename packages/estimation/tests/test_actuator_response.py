"""How a craft answers, as found by least squares: against SciPy's, and in worlds whose answer is known."""

import itertools

import numpy as np
import pytest
from rans_estimation.actuator_response import Response
from scipy.optimize import lsq_linear

from rans import TASKS, BodyConditions, Conditions, ThrusterConditions
from rans.episode.step import Setup, World
from rans.tasks.derived import layout
from tests.support.engines import FLYER, PLATFORM
from tests.support.filter_flights import COUNT, TIMING, commands, followed, made

LATE = 0.05
SLOW = 1.25


def test_it_is_the_least_squares_of_all_there_was():
    """With what was known before as two more rows; covariances do not wander between readings here."""
    random = np.random.default_rng(1)
    spread = 4.0
    variance = 0.3
    found = Response(0.0, 0.0, (spread, 0.0, spread), (), ())
    rows = [np.eye(2) / np.sqrt(spread)]
    off = [np.zeros(2)]
    for _ in range(12):
        now, then = random.normal(size=(2, 3))
        rows.append(np.stack((now, then), axis=1) / np.sqrt(variance))
        off.append(
            (0.4 * now - 0.2 * then + np.sqrt(variance) * random.normal(size=3)) / np.sqrt(variance)
        )
        # A filter expects what it knows already, so that it is told what is left.
        left = np.sqrt(variance) * off[-1] - (found.more * now + found.late * then)
        found = found._replace(last=list(now), previous=list(then)).updated(list(left), variance)
    told = np.concatenate(rows)
    best = lsq_linear(told, np.concatenate(off)).x
    np.testing.assert_allclose([found.more, found.late], best, rtol=1e-9)
    xx, xy, yy = found.covariance
    np.testing.assert_allclose([[xx, xy], [xy, yy]], np.linalg.inv(told.T @ told), rtol=1e-9)
    assert np.abs(best - (0.4, -0.2)).max() < 0.2  # twice the deviation that 36 such readings leave


@pytest.mark.parametrize(
    ("craft", "conditions", "forces", "torques"),
    [
        (
            PLATFORM,
            Conditions(body=BodyConditions(mass=(SLOW, SLOW))),
            (1.0 / SLOW - 1.0, 0.0),
            (0.0, 0.0),
        ),
        (FLYER, Conditions(body=BodyConditions(inertia=(0.8, 0.8))), (0.0, 0.0), (0.25, 0.0)),
        (
            FLYER,
            Conditions(thrusters=ThrusterConditions(latency=(LATE, LATE))),
            (-0.25, 0.25),
            (-0.25, 0.25),
        ),
    ],
    ids=["a fourth heavier", "a fifth less inertia", "a fourth late"],
)
def test_what_is_not_as_designed_is_found(craft, conditions, forces, torques):
    """After 10 s of exact readings, with one nozzle in fifty open."""
    task = TASKS["go-to-pose"]()
    found_by = made(craft, task, 0.1, 25.0)
    world = World(Setup(craft, task, TIMING, conditions))
    given = itertools.islice(commands(craft, 0.02), 50)
    *_, (_, read, memory) = followed(world, found_by, given)
    told = found_by.estimate(layout(task, craft.dimension).body, read, memory)[-4:]
    found = np.median(np.broadcast_to(told, (4, COUNT)), axis=1)
    # A steady acceleration takes some of what thrusters give for its own, and turning costs a little.
    np.testing.assert_allclose(found, (*forces, *torques), rtol=0, atol=0.03)


def test_no_answer_is_more_than_twice_what_was_asked():
    """Beyond design, whatever a broken sensor says."""
    known = Response(0.0, 0.0, (25.0, 0.0, 25.0), [1.0, 0.0], [0.0, 1.0])
    found = known.updated([1e6, -1e6], 1.0)
    assert (found.more, found.late) == (2.0, -2.0)
