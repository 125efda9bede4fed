from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import pytest
import torch
import torch.distributed as dist
from torch.multiprocessing.spawn import start_processes

from rans import Engine
from rans.base.errors import WorkerLost
from rans.fast.distributed import ALONE, Processes, join
from rans.fast.learn.beginning import begin, statistics
from rans.fast.learn.config import MemorySettings, PPOSettings
from rans.fast.learn.ppo import PPOLearner
from rans.fast.learn.run_folder import RunFolder
from tests.support.command_runs import tiny
from tests.support.engines import NEAR, PLATFORM, SHORT
from tests.support.processes import PATIENCE, free_port, python
from tests.support.training import TINY, weights

ROOT = Path(__file__).parents[2]


class Clipped(PPOSettings):
    """Every gradient is longer than this, so that each process scales it by the norm of all."""

    max_grad_norm: ClassVar[float] = 0.1


_VALUES: Any = vars(TINY) | {"learning_rate": 2.0**-9}
SETTINGS = Clipped(**_VALUES)


def started(world: Processes = ALONE) -> PPOLearner:
    """A learner of 16 environments, or of this process's share of them, in float64, which remembers."""
    settings = replace(SETTINGS, memory=MemorySettings(4))
    engine = Engine(
        PLATFORM, NEAR, 16 // world.size, SHORT, seed=4, dtype=torch.float64, processes=world
    )
    return begin(engine, settings, 4)


def learned(model: PPOLearner) -> dict[str, Any]:
    """What three iterations make of it."""
    said: list[float] = []
    for _ in range(3):
        model.collect()
        said = model.update().tolist()
    state = model.state()
    return {
        "weights": weights(model.network),
        "rate": float(model.adam.rate),
        "random": state["generators"],
        "memory": state["memory"],
        "engine": model.engine.save_state()["buffers"],
        "log": statistics(said, model, 384),
    }


def one_of_two(rank: int, folder: Path) -> None:
    """A process of two, which learn together; the second leaves when both have."""
    torch.set_num_threads(1)
    dist.init_process_group("gloo", f"file://{folder}/meeting", rank=rank, world_size=2)
    world = Processes(rank, 2)
    found = learned(started(world)) | {
        "any": world.any(rank == 1, False),
        "first": world.from_first(f"from {rank}"),
    }
    torch.save(found, folder / f"{rank}.pt")
    if rank == 0:
        with pytest.raises(WorkerLost, match="another process of this command has ended"):
            world.average(torch.zeros(1))
    # Not by returning: threads of gloo that lost their peer abort a process now and then while it ends.
    os._exit(0)


@pytest.mark.slow
def test_two_processes_learn_what_one_does(tmp_path):
    """Same starts, actions and minibatches, and sums in another order: the same agents to rounding."""
    start_processes(one_of_two, (tmp_path,), nprocs=2)
    alone = learned(started())
    first, second = (torch.load(tmp_path / f"{rank}.pt") for rank in (0, 1))
    assert torch.equal(first["weights"], second["weights"])
    # Adam's steps of 2e-3 differ by the rounding of float64 sums, divided by gradients as small as 1e-5.
    torch.testing.assert_close(first["weights"], alone["weights"], rtol=0, atol=1e-9)
    assert first["rate"] == alone["rate"] != SETTINGS.learning_rate
    assert all(map(torch.equal, first["random"], alone["random"]))
    for ours, theirs in zip(first["engine"], alone["engine"], strict=True):
        assert torch.equal(ours, theirs)
    torch.testing.assert_close(first["memory"], alone["memory"], rtol=0, atol=1e-9)
    for name in (
        "train/loss",
        "train/approx_kl",
        "train/grad_norm",
        "rollout/failure_rate",
        "rollout/ep_len_mean",
        "return/turn",
    ):
        assert first["log"][name] == pytest.approx(alone["log"][name], rel=1e-9), name
    assert (first["any"], first["first"], second["first"]) == ((True, False), "from 0", "from 0")


def test_alone_nothing_changes():
    rows = torch.arange(6.0)
    assert ALONE.mine(rows) is ALONE.whole(rows) is ALONE.average(rows) is rows
    assert ALONE.any(True, False) == (True, False)
    assert join("cpu") is ALONE


MORTAL = """
import os, sys, threading, time
from pathlib import Path
from rans.cli import main
from rans.fast.learn import trainer

trainer._CHECKPOINT_SECONDS = 0.0  # instead of training for 5 s until there is one

def die():
    while not Path("run/checkpoint.safetensors").exists():
        time.sleep(0.05)
    os._exit(9)

if os.environ["RANK"] == "1":
    threading.Thread(target=die, daemon=True).start()
sys.exit(main(sys.argv[1:]))
"""
"""A second process that dies once there is a checkpoint."""


@pytest.mark.slow
def test_a_lost_process_leaves_a_sentence_and_a_checkpoint(tmp_path, monkeypatch, ran):
    """Which one process then resumes. They are on two machines, here both are this one."""
    monkeypatch.chdir(tmp_path)
    Path("mortal.py").write_text(MORTAL)
    command = [
        sys.executable,
        "-m",
        "torch.distributed.run",
        "--nnodes",
        "2",
        "--nproc-per-node",
        "1",
        "--rdzv-backend",
        "c10d",
        "--rdzv-id",
        "tests",
        "--rdzv-endpoint",
        f"localhost:{free_port()}",
        "--local-addr",
        "localhost",
        "--",
        "mortal.py",
        *tiny(total_timesteps=10**9),
        "--output",
        "run",
    ]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    nodes = [
        subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    errors = "".join(node.communicate(timeout=PATIENCE)[1] for node in nodes)
    assert all(node.returncode != 0 for node in nodes)
    sentence = (
        "rans: another process of this command has ended;"  # torchrun's own table may repeat it
    )
    assert len([line for line in errors.splitlines() if line.startswith(sentence)]) == 1, errors
    assert "Continue from the last checkpoint with --resume run." in errors
    steps = RunFolder(Path("run")).load_checkpoint("cpu")["steps"]
    config = Path("run/config.json")
    config.write_text(config.read_text().replace("1000000000", str(steps + 256)))
    assert f"Done after {steps + 256:,} steps" in ran("train --resume run")


@pytest.mark.slow
def test_who_waits_forever_hears_a_signal():
    """As where the GPU waits for a process that is gone: Python's own handlers then never run."""
    code = (
        "import signal, threading; from rans.fast.distributed import leave_when_stuck; "
        "signal.signal(signal.SIGTERM, lambda *_: None); leave_when_stuck(patience=0.1); "
        "print('waiting', flush=True); import time; time.sleep(10**6)"
    )
    with python("-c", code, cwd=ROOT) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "waiting\n"
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    assert errors.startswith("rans: stopped while waiting for another process")
