"""``--gpus``: a training, a sweep or an assurance in one process a GPU, started by torchrun."""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence

from rans.errors import ConfigError, brief
from rans.executors import without_option

DIVIDED = ("train", "sweep", "assure")
"""Commands whose processes under torchrun divide the work."""
_FORMS = "all, or a number of GPUs"


def without_gpus(arguments: Sequence[str]) -> tuple[list[str], str | None]:
    """Arguments of a command line without ``--gpus TEXT``, and its text; see `without_option`."""
    return without_option(arguments, "--gpus", _FORMS)


def on_gpus(arguments: Sequence[str], text: str) -> int:
    """Run a command in one process a GPU and return its exit code, that of the first process that failed.

    Without any GPU, a number starts so many processes on the CPU.

    Args:
        arguments: command and options, without ``--gpus``.
        text: "all", or a number.

    Raises:
        ConfigError: the command divides nothing, the text is neither, there are fewer GPUs, or this is already a
            process of torchrun.
    """
    import torch

    from rans.terminal import Terminal

    if arguments[0] not in DIVIDED:
        raise ConfigError(
            f"rans {arguments[0]} does not divide its work among GPUs, so that --gpus is not for it; it is for "
            f"{', '.join(DIVIDED)}."
        )
    if "WORLD_SIZE" in os.environ:
        raise ConfigError(
            "--gpus starts the processes itself: run the command without torchrun, or leave --gpus out."
        )
    available = torch.cuda.device_count()
    if text == "all" and available:
        count = available
    elif text == "all":
        raise ConfigError(
            "--gpus all needs a GPU, and there is none here; --gpus 2 starts two processes on the CPU."
        )
    elif text.isascii() and text.isdigit() and int(text) > 0:
        count = int(text)
    else:
        raise ConfigError(f"--gpus must be {_FORMS}; got {brief(text)}.")
    if available and count > available:
        raise ConfigError(f"--gpus must be at most the {available} GPUs here, got {count}.")
    if not available:
        Terminal().say(f"There is no GPU here: {count} processes use the CPU.")
    return _launched(arguments, count)


def _launched(arguments: Sequence[str], count: int) -> int:
    """Exit code of so many processes of a command under torchrun."""
    from torch.distributed.elastic.multiprocessing.api import SignalException
    from torch.distributed.elastic.multiprocessing.errors import ChildFailedError
    from torch.distributed.run import get_args_parser, run

    # Each process prints its own sentence; torchrun would add its stack and a summary.
    logging.getLogger("torch.distributed").setLevel(logging.CRITICAL)
    # One thread a process, as torchrun chooses with a warning.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    # After "--" no option of the command is taken for one of torchrun.
    options = ["--standalone", "--nproc-per-node", str(count), "-m", "--", "rans"]
    try:
        run(get_args_parser().parse_args([*options, *arguments]))
    except ChildFailedError as error:
        _, failure = error.get_first_failure()
        # A negative code is the number of the signal that ended the process.
        return failure.exitcode if failure.exitcode > 0 else 128 - failure.exitcode
    except SignalException as error:
        return 128 + int(error.sigval)
    return 0
