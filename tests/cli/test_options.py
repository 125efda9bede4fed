"""Options that are treated alike in all commands: repeated ones, and those with a number."""

from __future__ import annotations

import pytest

from rans.cli import _parse


@pytest.mark.parametrize("command", ["evaluate", "fly"])
def test_a_switch_has_one_meaning_and_its_number_an_option_beside_it(command: str) -> None:
    parsed = _parse([command, "avoid-2d", "--guard", "--guard-slack", "0.2"])
    assert (parsed.guard, parsed.guard_slack) == (True, 0.2)
    assert _parse([command, "avoid-2d", "--guard"]).guard_slack is None
