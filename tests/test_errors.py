"""Where an error of a user's code was raised."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from rans import errors


def test_a_users_file_beside_the_package_is_not_the_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A name that begins as the package's folder does, as of a project that extends it."""
    monkeypatch.setattr(errors, "__file__", str(tmp_path / "rans" / "errors.py"))
    file = tmp_path / "rans_mine.py"
    file.write_text("def act():\n    raise LookupError(3)\n", encoding="utf-8")
    spec = importlib.util.spec_from_file_location("rans_mine", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with pytest.raises(LookupError, match="3") as raised:
        module.act()
    assert errors.where_raised(raised.value) == " (rans_mine.py, line 2, in act)"
