"""What this package's reader of files makes of planted ones (`tests.support.reader_questions`)."""

from __future__ import annotations

from pathlib import Path

import pytest
from rans_assurance.follow.paths import read_path

from tests.support.reader_questions import (
    Answer,
    Answers,
    check_complete,
    check_said,
    planted,
    written,
)

ANSWERS: Answers = {
    "read_path": {
        "units": Answer(
            written("path.csv", "x (cm),y (cm)\n0,0\n9,0\n", read_path), "must be in m"
        ),
        "frames": "a path has the world's axes, and no file names others",
        "times": "a path has none: the speed is an option",
        "order": Answer(written("path.csv", "0,0\n1,0,0\n", read_path), "3 cells instead of 2"),
        "dropped": Answer(
            written("path.csv", "t,x,y\n0,0,0\n1,1,1\n", read_path), "not read", is_warning=True
        ),
        "sizes": Answer(
            written("path.csv", "#" + "x" * 2**20, read_path), "larger than field limit"
        ),
        "evidence": Answer(written("path.csv", "1,2\n1,2\n", read_path), "two different points"),
    },
}


def test_every_question_is_answered() -> None:
    check_complete(ANSWERS)


@pytest.mark.parametrize(("reader", "question"), planted(ANSWERS))
def test_a_file_that_means_something_else(reader: str, question: str, tmp_path: Path) -> None:
    check_said(ANSWERS, reader, question, tmp_path)
