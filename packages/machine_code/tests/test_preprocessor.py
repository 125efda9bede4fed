"""What a network sees, by generated kernels that run on the CPU."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import pytest
import torch
from rans_machine_code.cuda.preprocessor import CudaPreprocessor
from rans_machine_code.preprocessor import CpuPreprocessor

from rans import TASKS, Engine
from rans.fast.learn.beginning import architecture_of
from rans.fast.learn.config import FilterSettings, PPOSettings
from rans.policy.network import Network
from tests.support.engines import FLYER, PLATFORM
from tests.support.host_kernels import launch_on_host, needs_compiler

pytestmark = needs_compiler


@pytest.mark.parametrize(
    ("dtype", "task", "filters", "craft"),
    [
        (torch.float64, "multi-task", None, FLYER),
        (torch.float32, "multi-task", None, PLATFORM),
        (torch.float32, "go-to-pose", None, FLYER),
        # From one of its sides with responses, and from its own without.
        (torch.float64, "go-to-pose", (0.1, 0.0), FLYER),
        (torch.float64, "go-to-pose", (), PLATFORM),
        (torch.float32, "go-to-pose", (0.1, 0.0), PLATFORM),
        (torch.float32, "go-to-pose", (), FLYER),
    ],
    ids=lambda x: getattr(x, "name", str(x)),
)
def test_programs_see_and_filter_as_torch_does(dtype, task, filters, craft, monkeypatch):
    """In three steps of flight, from the same side."""
    engine = Engine(craft, TASKS[task](), 64, seed=3, dtype=dtype)
    settings = PPOSettings(n_envs=64, symmetric=TASKS[task].symmetric and filters != ())
    if filters is not None:
        settings = replace(settings, filters=FilterSettings((0.001, 1.0), filters))
    given = architecture_of(engine, settings)
    tensors = {name: x.to(dtype) for name, x in given.initial(0, 0.5)[0].items()}
    ours, theirs = (Network(given, tensors) for _ in range(2))
    plain = cast("Any", theirs._preprocessor)
    programs: Any = CpuPreprocessor(given, plain)
    if dtype == torch.float64:
        launch_on_host(monkeypatch)
        programs = CudaPreprocessor(given, plain, tensors["value_net.weight"])
    ours._preprocessor = programs
    assert ours.in_body(engine.observe().requires_grad_()).requires_grad
    if filters is None:
        programs._plain = cast("Any", None)  # nobody else looks from here on
    memory = theirs.initial_state(64)
    # Some fifty operations on numbers up to ten, and on larger ones in covariances.
    slack = {"rtol": 0.0, "atol": 1000 * torch.finfo(dtype).eps}
    for step in range(3):
        observation = engine.observe()
        columns = theirs.in_body(observation)
        for rows in (observation, observation.contiguous()):  # which lie in memory either way
            torch.testing.assert_close(ours.in_body(rows), columns, **slack)
        seen, _, place = ours.look(columns, memory)
        right, _, there = theirs.look(columns, memory)
        torch.testing.assert_close(seen, right, **slack)
        assert (place is None) == (there is None) == (not settings.symmetric)
        if place is not None and there is not None:
            assert torch.equal(place, there)
        with torch.no_grad():  # as agents in training look; on a CPU all at once
            said, right = (each.evaluate(observation, memory) for each in (ours, theirs))
        torch.testing.assert_close(said.value, right.value, **slack)
        torch.testing.assert_close(said.policy.mode(), right.policy.mode(), rtol=0, atol=0)
        drawn = torch.rand(64, given.thrusters, generator=torch.Generator().manual_seed(step))
        command = (drawn < 0.2).to(dtype)
        if memory is not None:
            found, memory = (each.next_state(columns, memory, command) for each in (ours, theirs))
            torch.testing.assert_close(found, memory, rtol=slack["atol"], atol=slack["atol"])
        engine.step(command)
