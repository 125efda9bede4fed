"""What a network sees, by generated kernels that run on the CPU."""

from __future__ import annotations

import tempfile
from ctypes import CDLL, c_int, c_uint, c_void_p
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import pytest
import torch

from rans.compile.preprocess import CpuPreprocessor, CudaPreprocessor
from rans.fast.engine import Engine
from rans.fast.learn.beginning import architecture_of
from rans.fast.learn.config import FilterSettings, PPOSettings
from rans.model.spacecraft import Spacecraft
from rans.policy.architecture import Architecture
from rans.policy.network import Network
from rans.tasks import TASKS
from tests.support.engines import FLYER, PLATFORM
from tests.support.host_kernels import compiled_on_host, needs_compiler

pytestmark = needs_compiler


class HostLook(CudaPreprocessor):
    """Its kernels made by a C++ compiler."""

    def __init__(self, given: Architecture, plain: Any) -> None:
        super().__init__(given, plain, torch.device("cpu"), torch.float64)

    @cached_property
    def _functions(self) -> Any:
        folder = Path(tempfile.mkdtemp())
        return [
            compiled_on_host(text, folder / f"rows_{i}") for i, text in enumerate(self.sources())
        ]

    def _launch(self, number: int, pointers: list[int], numbers: list[int]) -> None:
        library: CDLL = self._functions[number]
        index = c_uint.in_dll(library, "blockIdx")
        for index.value in range(numbers[0]):
            library.rows(*map(c_void_p, pointers), *map(c_int, numbers))


@pytest.mark.parametrize(
    ("dtype", "task", "craft"),
    [
        (torch.float64, "go-to-pose", PLATFORM),
        (torch.float64, "multi-task", FLYER),
        (torch.float32, "go-to-pose", FLYER),
        (torch.float32, "multi-task", PLATFORM),
    ],
    ids=lambda x: getattr(x, "name", str(x)),
)
def test_programs_see_what_torch_sees(
    dtype: torch.dtype,
    task: str,
    craft: Spacecraft,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From the same side, so that thrusters are in the same places; rows lie in memory either way."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    engine = Engine(craft, TASKS[task](), 64, seed=3, dtype=dtype)
    settings = PPOSettings(n_envs=64, symmetric=TASKS[task].symmetric)
    given = architecture_of(engine, settings)
    tensors = {name: x.to(dtype) for name, x in given.initial(0, 0.5)[0].items()}
    ours = Network(given, tensors)
    slack = 100 * torch.finfo(dtype).eps
    theirs = Network(given, tensors)
    observation = engine.observe()
    programs: Any = (CpuPreprocessor if dtype == torch.float32 else HostLook)(
        given, cast("Any", theirs._preprocessor)
    )
    ours._preprocessor = programs
    assert ours.in_body(observation.clone().requires_grad_()).requires_grad
    programs._plain = None  # nobody else looks from here on
    for rows in (observation, observation.contiguous()):
        columns = ours.in_body(rows)
        # The sums of three products, of metres up to ten, may be rounded in another order.
        torch.testing.assert_close(columns, theirs.in_body(rows), rtol=0, atol=slack)
        (seen, _, place) = ours.look(columns)
        (right, _, there) = theirs.look(columns)
        torch.testing.assert_close(seen, right, rtol=0, atol=slack)
        assert (place is None) == (not settings.symmetric)
        assert (place is there) if place is None or there is None else torch.equal(place, there)
    with torch.no_grad():  # as agents in training look; on a CPU all at once
        said = ours.evaluate(observation)
        right = theirs.evaluate(observation)
    # Values of about 1, of sums in another order.
    torch.testing.assert_close(said.value, right.value, rtol=0, atol=10 * slack)
    torch.testing.assert_close(said.policy.mode(), right.policy.mode(), rtol=0, atol=0)


@pytest.mark.parametrize(
    ("dtype", "symmetric", "craft"),
    [
        (torch.float64, True, FLYER),
        (torch.float64, False, PLATFORM),
        (torch.float32, True, PLATFORM),
        (torch.float32, False, FLYER),
    ],
    ids=lambda x: getattr(x, "name", str(x)),
)
def test_programs_filter_as_torch_does(
    dtype: torch.dtype,
    symmetric: bool,
    craft: Spacecraft,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Three steps of flight; the kernels also where torch compiles what is around them."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    engine = Engine(craft, TASKS["go-to-pose"](), 64, seed=3, dtype=dtype)
    given = architecture_of(
        engine,
        PPOSettings(
            n_envs=64,
            symmetric=symmetric,
            filters=FilterSettings((0.001, 1.0), (0.1, 0.0) * symmetric),
        ),
    )
    tensors = {name: x.to(dtype) for name, x in given.initial(0, 0.5)[0].items()}
    ours = Network(given, tensors)
    theirs = Network(given, tensors)
    ours._preprocessor = programs = (CpuPreprocessor if dtype == torch.float32 else HostLook)(
        given, cast("Any", theirs._preprocessor)
    )
    memory = theirs.initial_state(64)
    look = (
        ours.look
        if dtype == torch.float32
        else torch.compile(ours.look, fullgraph=True, dynamic=False, backend="eager")
    )
    for step in range(3):
        columns = theirs.in_body(engine.observe())
        (seen, _, place) = look(columns, memory)
        (right, _, there) = theirs.look(columns, memory)
        assert right.shape == (
            64,
            3 * given.column_count + (3 * (craft.dimension - 1) + 4 if symmetric else 0),
        )
        # Some fifty operations on numbers up to ten.
        torch.testing.assert_close(seen, right, rtol=0, atol=1000 * torch.finfo(dtype).eps)
        assert (place is None) == (there is None)
        if place is not None and there is not None:
            assert torch.equal(place, there)
        drawn = torch.rand(64, given.thrusters, generator=torch.Generator().manual_seed(step))
        command = (drawn < 0.2).to(dtype)
        # As many operations; covariances are larger numbers.
        found, memory = (each.next_state(columns, memory, command) for each in (ours, theirs))
        torch.testing.assert_close(
            found, memory, rtol=1000 * torch.finfo(dtype).eps, atol=1000 * torch.finfo(dtype).eps
        )
        engine.step(command)
    assert programs is ours._preprocessor
