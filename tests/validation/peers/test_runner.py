from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import validation.peers.runner as runner
from validation.peers.runner import Peer, measure_peer

SCRIPT = """import json, sys
print("said before")
print(json.dumps({"arguments": sys.argv[1:], "device": "cpu"}))
"""


def peer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> Peer:
    """A script in a folder of its own, for a module that is always there."""
    monkeypatch.setattr(runner, "_FOLDER", tmp_path)
    (tmp_path / "script.py").write_text(script)
    return Peer("package", "json", "script.py", ("package==1",))


def test_a_peers_last_line_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = measure_peer(peer(tmp_path, monkeypatch, SCRIPT), "cpu", tmp_path, quick=True)
    assert result.figures == {"arguments": ["--device", "cpu", "--quick"], "device": "cpu"}
    assert result.command.endswith("script.py --device cpu --quick")
    assert (result.installed_by, result.reason) == ("", "")


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("raise ValueError('no luck')", "ValueError: no luck"),
        ("import sys; sys.exit(3)", "exit code 3"),
        ("print('no JSON')", "Expecting value"),
        ("", "list index out of range"),
        ("import time; time.sleep(60)", "not done after 0 s"),
    ],
)
def test_a_peer_cannot_break_the_benchmark(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, reason: str
) -> None:
    if "sleep" in script:
        monkeypatch.setattr(runner, "_RUN_SECONDS", 0.3)
    result = measure_peer(peer(tmp_path, monkeypatch, script), "cpu", tmp_path)
    assert result.figures == {}
    assert reason in result.reason


def test_the_reason_is_the_error_and_not_pips_excuse() -> None:
    text = (
        "Collecting x\n  urllib.error.URLError: <no network>\n  [end]\n\nnote: not pip's fault.\n"
    )
    assert runner._last_error(text) == "urllib.error.URLError: <no network>"
    assert runner._last_error("something\nelse\n\n") == "else"


def test_an_environment_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[Any] = []
    monkeypatch.setattr(runner, "_output", lambda command, *_: done.append(command) or "{}\n")
    monkeypatch.setattr(
        runner.venv, "create", lambda home, **_: home.mkdir(parents=True, exist_ok=True)
    )
    for version in ("1", "1", "2"):
        absent = Peer("package", "no_such_module", "script.py", (f"rejax=={version}", "jax==3"))
        measure_peer(absent, "cuda", tmp_path)
    installed = [command[-2:] for command in done if "pip" in command]
    assert installed == [["rejax==1", "jax[cuda12]==3"], ["rejax==2", "jax[cuda12]==3"]]


def test_every_peer_has_its_script_and_versions() -> None:
    for given in runner.PEERS:
        assert (Path(runner.__file__).parent / given.script).is_file()
        assert all("==" in requirement for requirement in given.requirements)
        assert Path(given.script).stem != given.module  # it would be imported in the module's place
