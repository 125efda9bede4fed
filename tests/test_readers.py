"""Files are opened by few modules of the package, which bound what they read and refuse links, pipes and depth."""

from __future__ import annotations

import ast
import os
import tomllib
from pathlib import Path

import pytest

from rans import ConfigError
from rans.base.files import (
    open_regular,
    read_bytes,
    read_json,
    read_json_lines,
    read_text,
)
from tests.support.sources import sources

TABLES = tomllib.loads((Path(__file__).parent / "data" / "readers.toml").read_text("utf-8"))
"""Calls that read, modules that may, and why other modules have some of them."""
CALLS = TABLES["calls"]
ENDS = {call.rpartition(".")[2] for call in CALLS}
ALLOWED = {(name, call) for name, calls in TABLES["allowed"].items() for call in calls}
OWN = ("resources.files", "files(")
"""Whose texts are files of the package."""


def opens(text: str) -> list[str]:
    """Names in `CALLS` of all calls of a module that read what may be a stranger's."""
    if not any(f"{end}(" in text for end in ENDS):  # which saves most of the time
        return []
    found = []
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.Call):
            continue
        last = getattr(node.func, "attr", getattr(node.func, "id", ""))
        if last not in ENDS:
            continue
        name = ast.unparse(node.func)
        arguments = [ast.unparse(one) for one in node.args]
        is_written = any(
            mode in arguments for mode in ("'w'", "'wb'", "'w+b'", "'xb'", "'a'", "'x'")
        )
        is_other = name in ("webbrowser.open", "zenoh.open", "Image.open", "inbox.open")
        is_ours = name in ("read_text", "read_bytes") or name.startswith("files.read_")
        is_own = any(own in name for own in OWN)
        is_round_trip = arguments[:1] and arguments[0].startswith("json.dumps(")
        if is_written or is_other or is_ours or is_own or is_round_trip:
            continue
        found += [call for call in CALLS if name == call or name.endswith(f".{call}")]
    return found


def test_files_are_opened_by_the_readers_alone():
    used = set()
    for name, file in sources():
        if name in TABLES["readers"]:
            continue
        used |= {(name, call) for call in opens(file.read_text("utf-8"))}
    assert used - ALLOWED == set(), "use rans.base.files"
    assert ALLOWED - used == set(), "an exception that no module needs"


@pytest.mark.parametrize(
    "text",
    [
        "x = Path(name).read_text()",
        "with open(file) as stream:\n    pass",
        "with file.open('rb') as stream:\n    pass",
        "json.loads(message.data)",
        "numpy.lib.np.load(file)",
        "import tomllib\ntomllib.load(stream)",
        "safetensors.torch.load_file(name)",
    ],
)
def test_what_would_be_seen(text):
    assert opens(text)


def test_a_pipe_is_refused_at_once(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    bounded = lambda x: read_bytes(x, 1)  # noqa: E731
    for read in (open_regular, read_json, read_text, read_json_lines, bounded):
        for place in (pipe, tmp_path, Path("/dev/zero")):
            with pytest.raises(
                ConfigError, match="it is not a file, but a folder, a pipe or a device"
            ):
                read(place)
