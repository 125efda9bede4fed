"""Several processes, started by torchrun: each has a GPU and its share of one training's environments.

Or of the members of a sweep and of the flights of an assurance, where processes work apart. In one training
process r of n owns every n-th environment of the batch, from environment r on, and draws the random numbers
that these environments would get on one process. A minibatch so holds the same transitions however many
processes share it, and averaged gradients are those of one process up to the order of summation.
"""

from __future__ import annotations

import atexit
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from typing import Any

import torch
import torch.distributed as dist
from torch import Tensor

from rans.errors import ConfigError, WorkerLost


@dataclass(frozen=True)
class Processes:
    """The processes of one training, seen from one of them; alone, everything is the identity."""

    rank: int = 0
    size: int = 1

    @property
    def is_first(self) -> bool:
        """Whether this process writes the run folder and speaks to the user."""
        return self.rank == 0

    def share(self, name: str, count: int) -> int:
        """This process's part of a number of things; ConfigError where it cannot be divided."""
        if count % self.size:
            raise ConfigError(
                f"{name} must be a multiple of the {self.size} processes, got {count}."
            )
        return count // self.size

    def mine(self, whole: Any) -> Any:
        """This process's rows of the whole batch's."""
        return whole[self.rank :: self.size] if self.size > 1 else whole

    def whole(self, mine: Tensor) -> Tensor:
        """The whole batch's rows from every process's; all must ask."""
        if self.size == 1:
            return mine
        parts = [torch.empty_like(mine) for _ in range(self.size)]
        _collective(dist.all_gather, parts, mine)
        return torch.stack(parts, dim=1).flatten(0, 1)

    def uniform_like(self, mine: Tensor, generator: torch.Generator | None = None) -> Tensor:
        """Random numbers in [0, 1) for (T, rows, ...) of this process's rows; all must draw as often."""
        draw = partial(torch.rand, dtype=mine.dtype, device=mine.device, generator=generator)
        if self.size == 1:
            return draw(mine.shape)
        shape = (self.size * mine.shape[1], *mine.shape[2:])
        return torch.stack([self.mine(draw(shape)) for _ in range(len(mine))])

    def average(self, tensor: Tensor) -> Tensor:
        """Mean over the processes, which all must ask for."""
        if self.size == 1:
            return tensor
        total = tensor.clone()
        _collective(dist.all_reduce, total)
        return total / self.size

    def pooled(self, variance: Tensor, mean: Tensor) -> tuple[Tensor, Tensor]:
        """Variance and mean of all processes' values from those of each; all have as many."""
        together = self.average(mean)
        return self.average(variance + (mean - together).square()), together

    def standardised(self, values: Tensor) -> Tensor:
        """Values (K, rows) less their mean over all processes' rows, over their spread, as SB3."""
        if self.size == 1:
            spread, mean = torch.std_mean(values, dim=1, keepdim=True)
            return (values - mean) / (spread + 1e-8)
        count = self.size * values.shape[1]
        centred = values - self.average(values.mean(dim=1, keepdim=True))
        variance = self.average(centred.square().mean(dim=1, keepdim=True)) * (count / (count - 1))
        return centred / (variance.sqrt() + 1e-8)

    def any(self, *flags: bool) -> tuple[bool, ...]:
        """Per flag, whether it is set on any process: decisions that all must take alike."""
        if self.size == 1:
            return flags
        asked = torch.tensor(flags, dtype=torch.int32)
        _collective(dist.all_reduce, asked, dist.ReduceOp.MAX)
        return tuple(map(bool, asked.tolist()))

    def from_first(self, value: Any) -> Any:
        """What the first process holds."""
        if self.size == 1:
            return value
        box = [value]
        _collective(dist.broadcast_object_list, box, device=torch.device("cpu"))
        return box[0]

    def part(self, count: int) -> tuple[int, int]:
        """First of so many things that are this process's, and how many are."""
        first, end = (count * place // self.size for place in (self.rank, self.rank + 1))
        return first, end - first

    def from_all(self, value: Any) -> list[Any]:
        """What every process holds, in the order of their ranks; all must ask."""
        said = [value] * self.size
        if self.size > 1:
            _collective(dist.all_gather_object, said, value)
        return said


ALONE = Processes()
_PATIENCE = timedelta(days=30)
"""For the slowest of processes that work apart."""


def join(device: str, apart: bool = False) -> Processes:
    """The processes torchrun started, this one among them; `ALONE` where it started none.

    From then on ``cuda`` means this process's own GPU; ConfigError where there are too few. Those that work
    ``apart`` meet on the CPU alone, and wait for one another as long as it takes.
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
    if device.startswith("cuda") and not apart:
        # Decisions travel through the CPU, so that asking does not wait for the GPU.
        dist.init_process_group(
            "cpu:gloo,cuda:nccl", device_id=torch.device("cuda", torch.cuda.current_device())
        )
    else:
        dist.init_process_group("gloo", timeout=_PATIENCE if apart else None)
        # A thread of its own that still works while Python ends would abort the process.
        atexit.register(dist.destroy_process_group)
    leave_when_stuck()
    return Processes(dist.get_rank(), size)


def leave_when_stuck(patience: float = 15.0) -> None:
    """End this process so many seconds after it was told to, if it has not done so by itself.

    Who waits on the GPU for a process that is gone hears no signal: Python handles them between two lines
    of the main thread, which waits. torchrun would kill such a process without a word.
    """

    def leave() -> None:
        ears.recv(1)
        time.sleep(patience)
        sys.stderr.write(
            "rans: told to stop while waiting for another process of this training; go on from "
            "the last checkpoint with --resume.\n"
        )
        sys.stderr.flush()
        os._exit(1)

    ears, mouth = socket.socketpair()
    mouth.setblocking(False)
    signal.set_wakeup_fd(mouth.detach())
    threading.Thread(target=leave, daemon=True).start()


def _collective(function: Callable[..., Any], *arguments: Any, **settings: Any) -> None:
    """Do what all processes must do together; WorkerLost where another one is gone."""
    try:
        function(*arguments, **settings)
    except RuntimeError as error:
        raise WorkerLost(
            "another process of this command is gone; the usual cause is lack of memory, "
            "and its own message is above."
        ) from error
