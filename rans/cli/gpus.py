"""``--gpus``: a training, a sweep or an assurance in one process a GPU, started by torchrun."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from rans.errors import ConfigError, brief, counted
from rans.executors import without_option
from rans.files import read_text, write_text

DIVIDED = ("train", "sweep", "assure")
"""Commands whose processes under torchrun divide the work."""
_FORMS = "all, or a number of GPUs"
_FOLDER = "RANS_SENTENCES"
"""Environment variable with the folder in which processes leave their last sentences."""
_INTERRUPTED = ".interrupted"
"""End of the name of a file with the sentence of an interrupt."""


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
    # As many processes as GPUs, or as were asked for.
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
    if available:
        Terminal(stderr=True).say(f"Starting a process on each of {counted(count, 'GPU')}.")
    else:
        Terminal().say(f"There is no GPU here: {count} processes use the CPU.")
    return _launched(arguments, count)


def leave_sentence(sentence: str, is_interrupt: bool = False) -> bool:
    """Leave the last sentence of a process of `on_gpus` to what started it; False: this process is none.

    Sentences of interrupts are printed only where no process failed: torchrun interrupts the others then.
    """
    folder = os.environ.get(_FOLDER)
    if folder is None or "RANK" not in os.environ:
        return False
    name = os.environ["RANK"] + (_INTERRUPTED if is_interrupt else "")
    try:
        write_text(Path(folder, name), sentence)
    except ConfigError:  # a full disk must not hide the sentence
        return False
    return True


@contextmanager
def _sentences_in(folder: Path) -> Iterator[None]:
    """Context in which processes leave their last sentences in a folder; at its end each is printed once.

    Where all were interrupted, it is that of the first.
    """
    os.environ[_FOLDER] = str(folder)
    try:
        yield
    finally:
        del os.environ[_FOLDER]
        files = sorted(folder.iterdir())
        failures = [file for file in files if file.suffix != _INTERRUPTED]
        # Of an interrupt the first process alone knows what was written.
        texts = [read_text(file) for file in failures or files[:1]]
        for text in dict.fromkeys(texts):
            print(text, file=sys.stderr)


def _launched(arguments: Sequence[str], count: int) -> int:
    """Exit code of ``count`` processes of a command under torchrun: the first failure's, or 128 + signal."""
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
        with TemporaryDirectory() as folder, _sentences_in(Path(folder)):
            run(get_args_parser().parse_args([*options, *arguments]))
    except ChildFailedError as error:
        _, failure = error.get_first_failure()
        # A negative code is the number of the signal that ended the process.
        return failure.exitcode if failure.exitcode > 0 else 128 - failure.exitcode
    except SignalException as error:
        return 128 + int(error.sigval)
    return 0
