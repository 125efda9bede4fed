"""Options that are treated alike in all commands: repeated ones, and those with a number."""

from __future__ import annotations

from pathlib import Path

import pytest

from rans.cli import _parse, main
from rans.cli.compare import Compare
from rans.cli.options import with_numbers_named
from tests.support.installed import needs_command


@pytest.mark.parametrize("second", [["--certified", "4"], ["--certified=4"]])
def test_an_option_twice_is_told(
    second: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The last counts, as everywhere: whoever has an alias may go on."""
    assert (
        main(
            ["compare", "pretrained:nobody", "--certified", "3", *second, "--output", str(tmp_path)]
        )
        == 2
    )
    assert (
        "warning: '--certified' is given twice; the last value is used" in capsys.readouterr().err
    )


def test_a_number_may_follow_the_guard_and_a_run_too() -> None:
    assert with_numbers_named(Compare, ["--guard", "0.01", "--seed", "3"]) == [
        "--guard",
        "--guard-slack=0.01",
        "--seed",
        "3",
    ]
    assert with_numbers_named(Compare, ["--guard", "runs/first"]) == ["--guard", "runs/first"]


@pytest.mark.parametrize("command", ["compare", "evaluate", "fly", "view"])
def test_every_guard_takes_a_number(command: str) -> None:
    needs_command(command)
    assert _parse([command, "avoid-2d", "--guard", "0.2"]).guard_slack == 0.2


def test_a_number_has_no_option_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    """It goes with the option before it, and is read nowhere else."""
    command = _parse(["compare", "go-to-pose-2d", "--guard", "0.2"])
    assert (command.guard, command.guard_slack) == (True, 0.2)
    assert main(["compare", "go-to-pose-2d", "--guard", "--guard-slack", "0.2"]) == 2
    assert "has no option --guard-slack" in capsys.readouterr().err
