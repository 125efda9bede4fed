"""What RANS computes is the same whatever a user has set in torch, NumPy and Python for code of their own."""

from __future__ import annotations

import random
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from threading import Thread
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from safetensors.torch import load

import rans
from rans.base.settled import settled
from rans.fast.agent_files.tensors import pack_tensors, unpack_tensors


@contextmanager
def double() -> Iterator[None]:
    torch.set_default_dtype(torch.float64)
    yield
    assert torch.get_default_dtype() == torch.float64
    torch.set_default_dtype(torch.float32)


@contextmanager
def another_device() -> Iterator[None]:
    """The one without numbers stands for a GPU: whatever is computed there cannot be read."""
    torch.set_default_device("meta")
    yield
    assert torch.get_default_device().type == "meta"
    torch.set_default_device("cpu")


@contextmanager
def raising() -> Iterator[None]:
    with np.errstate(all="raise"):
        yield
        assert set(np.geterr().values()) == {"raise"}


SWITCHES: dict[str, Callable[[], Any]] = {
    "torch in double precision": double,
    "another default device": another_device,
    "NumPy raises": raising,
    "no gradients": torch.no_grad,
}


def table(agent: rans.Agent) -> list[float]:
    return [row.value for row in agent.evaluate(episodes=8).rows]


def steps() -> np.ndarray:
    """Observations of environments of NumPy and torch, and of Stable-Baselines3, with the same commands."""
    make: Any = gymnasium.make_vec
    env = make("rans/GoToPose2D-v0", num_envs=4, vectorization_mode="vector_entry_point")
    seen = [np.asarray(env.reset(seed=0)[0], np.float64)]
    sb3 = rans.SB3VecEnv(rans.Engine("floating-platform", rans.GoToPose(), num_envs=4))
    sb3.seed(1)
    sb3.reset()
    commands = np.tile([1, 0, 0, 1, 0, 0, 0, 1], (4, 1))
    for _ in range(130):  # beyond the end of episodes
        seen.append(np.asarray(env.step(torch.asarray(commands))[0], np.float64))
        seen.append(np.asarray(sb3.step(commands)[0], np.float64))
    single = gymnasium.make("rans/GoToPose3D-v0")
    seen.append(single.reset(seed=3)[0].reshape(1, -1)[:, :10].astype(np.float64))
    return np.concatenate(seen)


@pytest.fixture(scope="module")
def usual() -> tuple[list[float], np.ndarray]:
    return table(rans.load_agent("go-to-pose-2d")), steps()


@pytest.mark.parametrize("name", SWITCHES)
def test_flights_and_environments(name, usual):
    with SWITCHES[name]():
        agent = rans.load_agent("go-to-pose-2d")
        rows = table(agent)
        seen = steps() if name != "another default device" else None
    np.testing.assert_array_equal(rows, usual[0])
    if seen is not None:
        np.testing.assert_array_equal(seen, usual[1])


@pytest.mark.slow
def test_a_training_and_its_report(tmp_path):
    """With all that a user may set at once but the device, from which no report could read."""
    files = []
    for run in (tmp_path / "a", tmp_path / "b"):
        with ExitStack() as switches:
            for switch in (double, raising, torch.no_grad) if run.name == "b" else ():
                switches.enter_context(switch())
            rans.train("go-to-pose", output=run, total_timesteps=70_000)
            assert rans.report(run).exists()
        files.append((run / "agent.safetensors").read_bytes())
    first, second = (unpack_tensors(content, "an agent") for content in files)
    for key, weights in first["weights"].items():
        torch.testing.assert_close(second["weights"][key], weights, rtol=0, atol=0)


def test_random_numbers_of_a_user_go_on(monkeypatch):
    """Libraries draw some when they are imported, such as rich."""
    for module in [name for name in sys.modules if name.partition(".")[0] == "rich"]:
        monkeypatch.delitem(sys.modules, module)
    random.seed(1)
    before = random.getstate()
    table(rans.load_agent("go-to-pose-2d"))
    assert random.getstate() == before


def test_calls_of_several_threads_restore_a_users_type():
    seen = set()

    @settled
    def ask(deep):
        seen.add(torch.zeros(1).dtype)
        if deep:
            ask(deep - 1)

    with double():
        threads = [Thread(target=lambda: [ask(3) for _ in range(200)]) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert seen == {torch.float32}


def test_equal_agents_are_equal_files():
    """The library orders its metadata by a hash with another seed in every call."""
    tree = {"b": torch.arange(3), "é": 1, "a": {"x": torch.ones(2, 2), "y": [torch.zeros(1)]}}
    contents = {pack_tensors(tree) for _ in range(20)}  # in the library's order they are two
    assert len(contents) == 1
    (content,) = contents
    read = unpack_tensors(content, "it")
    assert read["é"] == 1
    assert read["a"]["x"].tolist() == [[1.0, 1.0], [1.0, 1.0]]
    assert load(content).keys() == {"b", "a/x", "a/y/0"}  # the library itself reads it
