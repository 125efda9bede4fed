"""Spacecraft of one engine whose masses and moments of inertia differ."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from rans import Engine, GoToPose, SensorConditions, Spacecraft
from rans.model.body import Body
from tests.support.crafts import heavier
from tests.support.engines import FLYER, NEAR, PLATFORM, SHORT, actions, both_crafts

SCALES = torch.tensor([0.5, 1.0, 1.3, 4.0], dtype=torch.float64)


def scaled(craft: Spacecraft, scale: Any) -> Body:
    """Heavier and slower to turn by one factor, as if denser."""
    nominal = Body.of(craft)
    return Body(nominal.mass * scale, tuple(entry * scale for entry in nominal.inertia))


def flown(engine: Engine, steps: int = 25) -> torch.Tensor:
    """Observations (steps, N, width), over restarts."""
    return torch.stack(
        [engine.step(action).observation for action in actions(engine.craft, 4, steps)]
    )


@pytest.mark.parametrize(
    ("craft", "conditions"), [(PLATFORM, None), (FLYER, None), (PLATFORM, "lab")]
)
def test_each_flies_as_in_an_engine_of_its_like(craft, conditions):
    """What an episode draws is of the spacecraft's own mass, not of the design's."""
    how = {"dtype": torch.float64, "conditions": conditions}
    short = replace(
        SHORT, substeps=1
    )  # as many alone as together, where the liveliest decides for all
    together = flown(Engine(craft, NEAR, 4, short, body=scaled(craft, SCALES), **how))
    for i, scale in enumerate(SCALES.tolist()):
        alone = flown(Engine(heavier(craft, scale, scale), NEAR, 4, short, **how))
        # Rounding of 25 steps.
        torch.testing.assert_close(together[:, i], alone[:, i], rtol=0, atol=1e-11)


@pytest.mark.filterwarnings("ignore:spacecraft .* one command turns it")
@both_crafts
def test_what_a_simulator_knows(craft):
    """5.32 kg, 0.2045008 kg m^2 and 0.31 m of radius are one; so are a well thruster and one stuck open."""
    axes = craft.dimension
    others = len(craft.thrusters) - 3
    inertia = (0.1,) if axes == 2 else (0.1, 0.02, 0.0, 0.2, 0.0, 0.25)
    gain = (1.0, 0.6, 0.0, *[1.0] * others)
    leak = (0.0, 0.0, 1.0, *[0.0] * others)
    body = Body(torch.tensor([2.66, 10.64]), inertia, (0.031, *[-0.155] * (axes - 1)), gain, leak)
    engine = Engine(craft, GoToPose(), 2, body=body, dtype=torch.float64)
    moments = (0.4889956,) if axes == 2 else (0.4889956, 0.0977991, 0.0, 0.9779913, 0.0, 1.2224891)
    rest = (*moments, 0.1, *[-0.5] * (axes - 1), *gain, *leak)
    # Masses were given in float32; moments are worked out to seven digits.
    np.testing.assert_allclose(
        engine.privileged(), [(0.5, *rest), (2.0, *rest)], rtol=1e-6, atol=1e-7
    )
    assert engine.privileged_quantities.width == 1 + len(rest)


@pytest.mark.parametrize("compiled", [False, True])
def test_masses_written_in_place_take_effect(compiled):
    with torch.compiler.set_stance("force_eager"):
        light, heavy = (
            Engine(PLATFORM, NEAR, 4, SHORT, compiled=compiled, body=scaled(PLATFORM, scale))
            for scale in (SCALES, 4 * SCALES)
        )
        for field in (light.body.mass, *light.body.inertia):
            field *= 4  # a power of two rounds nothing
        assert torch.equal(flown(light), flown(heavy))


def test_settings_can_be_made_in_a_traced_step():
    """As `draw_sensors` does; a check of all their fields could not be traced."""
    made = torch.compile(
        lambda x: x * SensorConditions(noise=0.5).noise, fullgraph=True, backend="eager"
    )
    assert made(torch.ones(1)).item() == 0.5


def test_a_flat_body_in_float32_is_rigid():
    """The third moment of a disc is the sum of the others, up to float32's rounding."""
    side = torch.tensor([0.1, 0.3, 0.7, 1.1])
    Engine(FLYER, NEAR, 4, body=Body(5.0, (side, 0.0, 0.0, 1.7 * side, 0.0, 2.7 * side)))
