"""What RANS computes does not depend on process-wide settings of torch, NumPy and Python that a user has changed.

People of control set torch to double precision, let NumPy raise, or choose a default device for code of their own
in the same process. The functions that users call compute with the settings of a new process, and leave those of
the user as they were.
"""

from __future__ import annotations

import functools
import random
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from typing import Any, ParamSpec, TypeVar

import numpy as np

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

_lock = threading.Lock()
_within = 0
"""Calls that are under way in all threads: torch has one default type for the whole process."""
_users_dtype: Any = None
"""The user's default type of torch, while calls are under way; None: it is float32."""


@contextmanager
def _usual_dtype(torch: Any) -> Iterator[None]:
    """Context in which new tensors are float32; the last of calls at the same time restores the user's type."""
    global _users_dtype, _within
    with _lock:
        if _within == 0:
            _users_dtype = torch.get_default_dtype()
            torch.set_default_dtype(torch.float32)
        _within += 1
    try:
        yield
    finally:
        with _lock:
            _within -= 1
            if _within == 0:
                torch.set_default_dtype(_users_dtype)


@contextmanager
def _usual_settings() -> Iterator[None]:
    """Context with NumPy's usual handling of errors, and torch's usual type and device of new tensors."""
    torch = sys.modules.get("torch")  # what is not loaded is as it was
    with ExitStack() as stack:
        stack.enter_context(np.errstate(divide="warn", over="warn", under="ignore", invalid="warn"))
        if torch is not None and hasattr(torch, "get_default_device"):
            if _within or torch.get_default_dtype() != torch.float32:
                stack.enter_context(_usual_dtype(torch))
            if torch.get_default_device().type != "cpu":
                stack.enter_context(torch.device("cpu"))
        yield


def settled(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """A function that computes with the usual settings, such as a step; gradients are as its caller has them."""

    @functools.wraps(function)
    def inner(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        with _usual_settings():
            return function(*arguments, **options)

    return inner


def settled_alone(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """A function that is a whole task, such as a training: gradients are on, and `random` is left as it was."""

    @settled
    @functools.wraps(function)
    def inner(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        """The function with the settings of a new process; the user's random numbers go on as if it had not run."""
        # Libraries draw from it when they are imported.
        state = random.getstate()
        torch = sys.modules.get("torch")
        try:
            with nullcontext() if torch is None else torch.enable_grad():
                return function(*arguments, **options)
        finally:
            random.setstate(state)

    return inner
