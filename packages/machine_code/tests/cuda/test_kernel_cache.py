from __future__ import annotations

import pytest
from rans_machine_code.cuda.kernel_cache import folder, kept


@pytest.fixture(autouse=True)
def _cache(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_what_was_made_once_is_read():
    made = iter((b"first", b"second", b"third"))
    found = [kept(key, lambda: next(made)) for key in ("a", "a", "b", "a")]
    assert found == [b"first", b"first", b"second", b"first"]


def test_a_damaged_file_is_made_again():
    kept("a", lambda: b"right")
    (file,) = folder().iterdir()
    file.write_bytes(file.read_bytes()[:-1] + b"?")
    assert kept("a", lambda: b"again") == b"again"
    assert kept("a", lambda: b"never") == b"again"


def test_where_nothing_can_be_written_nothing_is_kept(tmp_path):
    (tmp_path / "cache").write_text("a file")
    assert kept("a", lambda: b"made") == b"made"
