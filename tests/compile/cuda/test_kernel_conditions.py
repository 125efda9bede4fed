"""The generated kernel under conditions against NumPy's equations."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from rans.fast.engine import Engine
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions, FaultConditions, ThrusterConditions
from rans.tasks import GoToPose
from tests.support.engines import FLYER, PLATFORM
from tests.support.host_kernels import SEED, compare, needs_compiler
from tests.support.worlds import EFFECTS, PAIRS

pytestmark = needs_compiler


@pytest.mark.parametrize(
    ("effect", "remember", "craft"),
    [
        # By turns in the plane and in space.
        *(
            (effect, False, (PLATFORM, FLYER)[number % 2])
            for number, effect in enumerate(one for one in EFFECTS if one != "all")
        ),
        *((effect, False, PLATFORM) for effect in ("all", "pairs")),
        ("all", True, PLATFORM),
    ],
    ids=lambda x: getattr(x, "name", str(x)),
)
def test_every_condition_is_drawn_and_flown_as_on_numpy(
    on_host: Any, effect: str, remember: bool, craft: Spacecraft
) -> None:
    made: Any = (craft, GoToPose(), 8, Timing(episode_steps=6))
    how: Any = {
        "seed": SEED,
        "dtype": torch.float64,
        "conditions": (EFFECTS | {"pairs": PAIRS})[effect],
    }
    ours = Engine(*made, **how)
    theirs = on_host(*made, **how, remember=remember)
    torch.testing.assert_close(theirs.observe(), ours.observe(), rtol=0, atol=1e-12)
    assert compare(ours, theirs, 13) > 8


@pytest.mark.parametrize(
    "conditions",
    [
        Conditions(thrusters=ThrusterConditions(latency=0.2)),
        Conditions(thrusters=ThrusterConditions(latency=0.33, rise=0.4, fall=0.1)),
        Conditions(faults=FaultConditions(count=1.0, time=0.67)),
    ],
    ids=["late", "late and gradual", "fault"],
)
def test_conditions_without_ranges_are_programs_too(on_host: Any, conditions: Conditions) -> None:
    """Where a period is cut is then known before; pieces of it come and go."""
    how: Any = {"seed": SEED, "dtype": torch.float64, "conditions": conditions}
    made: Any = (PLATFORM, GoToPose(), 8, Timing(episode_steps=12))
    assert compare(Engine(*made, **how), on_host(*made, **how)) > 8
