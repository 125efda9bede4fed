"""Options that are treated alike in all commands: repeated ones, and those with a number."""

from __future__ import annotations

from pathlib import Path

import pytest

from rans.cli import _parse, main


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


@pytest.mark.parametrize("command", ["evaluate", "fly"])
def test_a_switch_has_one_meaning_and_its_number_an_option_beside_it(command: str) -> None:
    parsed = _parse([command, "avoid-2d", "--guard", "--guard-slack", "0.2"])
    assert (parsed.guard, parsed.guard_slack) == (True, 0.2)
    assert _parse([command, "avoid-2d", "--guard"]).guard_slack is None
