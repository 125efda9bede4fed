"""Where an error of a user's code was raised."""

from __future__ import annotations

from pathlib import Path

import pytest

from rans import errors
from tests.support.scripts import module_of


def test_a_users_file_beside_the_package_is_not_the_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A name that begins as the package's folder does, as of a project that extends it."""
    monkeypatch.setattr(errors, "__file__", str(tmp_path / "rans" / "errors.py"))
    file = tmp_path / "rans_mine.py"
    file.write_text("def act():\n    raise LookupError(3)\n", encoding="utf-8")
    module = module_of(file)
    with pytest.raises(LookupError, match="3") as raised:
        module.act()
    assert errors.where_raised(raised.value) == " (rans_mine.py, line 2, in act)"
