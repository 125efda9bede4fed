"""Tensors of torch that are no ordinary ones, as actions of every environment."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import pytest
import torch
from torch import Tensor

import rans
from rans import ConfigError
from rans.base.inputs import dense

COUNT = 3
ODD: dict[str, Callable[[Tensor], Tensor]] = {
    "sparse_coo": lambda x: x.to_sparse(),
    "sparse_csr": lambda x: torch.atleast_2d(x).to_sparse_csr(),
    "nested": lambda x: torch.nested.nested_tensor([x]),
    "meta": lambda x: x.to("meta"),
    "mkldnn": lambda x: x.to_mkldnn(),
    "quantized": lambda x: torch.quantize_per_tensor(x, 1.0, 0, torch.quint8),
}


def _envs() -> dict[str, tuple[Any, Tensor]]:
    """Environments after their reset, and an action for each."""
    single = gymnasium.make("rans/GoToPose2D-v0")
    single.reset(seed=1)
    batched: Any = gymnasium.make_vec("rans/GoToPose2D-v0", num_envs=COUNT)
    batched.reset(seed=1)
    around = rans.SB3VecEnv(rans.Engine("floating-platform", "go-to-pose", COUNT))
    around.reset()
    return {
        "single": (single, torch.zeros(8)),
        "batched": (batched, torch.zeros(COUNT, 8)),
        "sb3": (around, torch.zeros(COUNT, 8)),
    }


@pytest.mark.parametrize("kind", ODD)
@pytest.mark.filterwarnings("ignore")  # torch says of most that they are prototypes
def test_what_is_no_ordinary_tensor_is_refused(kind):
    for env, action in _envs().values():
        with pytest.raises(ConfigError, match=rf"must be ordinary tensors, got a \S*{kind} one"):
            env.step(ODD[kind](action))


def test_complex_ones_are_refused_and_those_that_are_negated_later_taken():
    for env, action in _envs().values():
        for odd in (action.to(torch.complex64), action.to(torch.complex64).conj()):
            with pytest.raises(ConfigError, match=r"0 \(shut\) or 1 \(open\)"):
                env.step(odd)
        later = action.to(torch.complex64).conj().imag
        assert later.is_neg()
        env.step(later)


def test_ordinary_ones_are_not_copied():
    given = torch.zeros(COUNT, 8, requires_grad=True)
    assert dense(given).data_ptr() == given.data_ptr()
    assert not dense(given).requires_grad
