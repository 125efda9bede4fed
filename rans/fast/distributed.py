"""Distributed processes started by torchrun, each with a GPU and its share of the environments of a training.

In one training process r of n owns every n-th environment of the batch, from environment r on, with the random
numbers that these environments have in a single process. A minibatch thus has the same transitions for any number
of processes, and averaged gradients are those of one process up to the order of summation.
"""

from __future__ import annotations

import atexit
import os
import signal
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
import torch.distributed as dist
from torch import Tensor

from rans.base.errors import ConfigError, WorkerLost
from rans.base.system import to_stderr


@dataclass(frozen=True)
class Processes:
    """Group of processes as seen from one of them; for a single process all operations are the identity."""

    rank: int = 0
    size: int = 1

    @property
    def is_first(self) -> bool:
        """Whether this is the process that writes the run folder and prints."""
        return self.rank == 0

    def portion(self, name: str, count: int) -> int:
        """Portion of this process of a count.

        Raises:
            ConfigError: the count is not a multiple of the number of processes.
        """
        if count % self.size:
            raise ConfigError(
                f"{name} must be a multiple of the {self.size} processes, got {count}."
            )
        return count // self.size

    def mine(self, whole: Any) -> Any:
        """Rows of this process from those of the whole batch."""
        return whole[self.rank :: self.size] if self.size > 1 else whole

    def whole(self, mine: Tensor) -> Tensor:
        """Rows of the whole batch from those of every process; all processes must call it."""
        if self.size == 1:
            return mine
        parts = [torch.empty_like(mine) for _ in range(self.size)]
        _collective(dist.all_gather, parts, mine)
        return torch.stack(parts, dim=1).flatten(0, 1)

    def uniform_like(self, mine: Tensor, generator: torch.Generator | None) -> Tensor:
        """Random numbers in [0, 1) for the rows (T, rows, ...) of this process; all processes must call it."""
        draw = partial(torch.rand, dtype=mine.dtype, device=mine.device, generator=generator)
        if self.size == 1:
            return draw(mine.shape)
        shape = (self.size * mine.shape[1], *mine.shape[2:])
        return torch.stack([self.mine(draw(shape)) for _ in range(len(mine))])

    def average(self, tensor: Tensor) -> Tensor:
        """Mean over the processes; all must call it."""
        if self.size == 1:
            return tensor
        total = tensor.clone()
        _collective(dist.all_reduce, total)
        return total / self.size

    def pooled(self, variance: Tensor, mean: Tensor) -> tuple[Tensor, Tensor]:
        """Variance and mean over all processes from those of each, which has the same number of values."""
        together = self.average(mean)
        return self.average(variance + (mean - together).square()), together

    def standardised(self, values: Tensor) -> Tensor:
        """Values (K, rows) standardised over the rows of all processes, as in SB3.

        PPO's advantages of every minibatch. One process and several agree up to the order of summation.
        """
        if self.size == 1:
            spread, mean = torch.std_mean(values, dim=1, keepdim=True)
            return (values - mean) / (spread + 1e-8)
        count = self.size * values.shape[1]
        centred = values - self.average(values.mean(dim=1, keepdim=True))
        variance = self.average(centred.square().mean(dim=1, keepdim=True)) * (count / (count - 1))
        return centred / (variance.sqrt() + 1e-8)

    def any(self, *flags: bool) -> tuple[bool, ...]:
        """Whether each flag is set on any process, for decisions that must be the same on all."""
        if self.size == 1:
            return flags
        combined = torch.tensor(flags, dtype=torch.int32)
        _collective(dist.all_reduce, combined, dist.ReduceOp.MAX)
        return tuple(map(bool, combined.tolist()))

    def from_first(self, value: Any) -> Any:
        """Value of the first process."""
        if self.size == 1:
            return value
        box = [value]
        _collective(dist.broadcast_object_list, box, device=torch.device("cpu"))
        return box[0]


ALONE = Processes()


def join(device: str) -> Processes:
    """Join the processes that torchrun has started; `ALONE` without torchrun.

    Afterwards ``cuda`` is the GPU of this process.

    Args:
        device: device of the computation.

    Raises:
        ConfigError: there are fewer GPUs than processes.
    """
    size = int(os.environ.get("WORLD_SIZE", "1"))
    if size == 1:
        return ALONE
    if device.startswith("cuda"):
        local = int(os.environ["LOCAL_RANK"])
        count = torch.cuda.device_count()
        if local >= count:
            raise ConfigError(
                f"torchrun started more processes than the {count} GPUs here; lower "
                "--nproc-per-node."
            )
        torch.cuda.set_device(local)
        # Decisions are exchanged on the CPU, so that they do not wait for the GPU.
        dist.init_process_group(
            "cpu:gloo,cuda:nccl", device_id=torch.device("cuda", torch.cuda.current_device())
        )
    else:
        dist.init_process_group("gloo")
        # A thread that still runs while Python exits would abort the process.
        atexit.register(dist.destroy_process_group)
    leave_when_stuck()
    return Processes(dist.get_rank(), size)


def leave_when_stuck(patience: float = 15.0) -> None:
    """End this process ``patience`` seconds after a signal if it is still running.

    A process that waits on the GPU for a lost one does not handle signals, because Python does so between two
    lines of the main thread. torchrun would kill it without a message.
    """

    def leave() -> None:
        """End this process ``patience`` (s) after another sends a byte: a collective call waits for ever."""
        receiver.recv(1)
        time.sleep(patience)
        said = "rans: stopped while waiting for another process of this training; continue from "
        to_stderr(f"{said}the last checkpoint with --resume.")
        os._exit(1)

    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    signal.set_wakeup_fd(sender.detach())
    threading.Thread(target=leave, daemon=True).start()


def _collective(function: Callable[..., Any], *arguments: Any, **settings: Any) -> None:
    """Call a collective operation; WorkerLost if another process has ended."""
    try:
        function(*arguments, **settings)
    except RuntimeError as error:
        raise WorkerLost(
            "another process of this command has ended; the usual cause is lack of memory, "
            "and its message is above."
        ) from error
