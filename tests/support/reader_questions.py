"""The questions to every reader of files, and how a planted file is asked; each room has its readers' answers."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import rans
from rans import RansError

QUESTIONS = {
    "units": "Is the unit of each number stated or implied, and one that is stated compared?",
    "frames": "Are frames and labels that decide what numbers mean read, or refused?",
    "times": "Are instants, periods and gaps plausible before anything is allocated?",
    "order": "Are conventions of order, sign and scale held to?",
    "dropped": "Is what is not kept named?",
    "sizes": "Is everything bounded that the file decides the size of?",
    "evidence": "Can the result be, and does it fit what it is for?",
}


class Answer(NamedTuple):
    """What a reader makes of a planted file: a refusal or a warning whose sentence has this text."""

    plant: Callable[[Path], Callable[[], object]]
    """Writes the file into a folder, and returns the reading of it."""
    sentence: str
    is_warning: bool = False


def written(name: str, text: str, read: Callable[[Path], object]) -> Any:
    def plant(folder: Path) -> Callable[[], object]:
        (folder / name).write_text(text)
        return lambda: read(folder / name)

    return plant


Answers = Mapping[str, Mapping[str, Answer | str]]
"""By reader and question: a planted file, or why there is nothing to ask."""


@contextmanager
def said(answer: Answer) -> Any:
    if answer.is_warning:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "spacecraft .* cannot push and turn it")
            with pytest.warns(rans.RansWarning, match=answer.sentence):
                yield
    else:
        with pytest.raises(RansError, match=answer.sentence):
            yield


def planted(answers: Answers) -> Any:
    """The mark of a test that is given each planted file as its ``answer``.

    Every question has an answer of every reader, and every reader refuses something.
    """
    for reader, own in answers.items():
        assert own.keys() == QUESTIONS.keys(), reader
        assert any(isinstance(answer, Answer) for answer in own.values()), reader
    asked = [
        pytest.param(answer, id=f"{reader}-{question}")
        for reader, own in answers.items()
        for question, answer in own.items()
        if isinstance(answer, Answer)
    ]
    return pytest.mark.parametrize("answer", asked)


def check_said(answer: Answer, folder: Path) -> None:
    """The reader refuses or names what the planted file means."""
    ask = answer.plant(folder)
    with said(answer):
        ask()
