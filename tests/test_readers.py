"""Files are opened by few modules of the package, which bound what they read and refuse links, pipes and depth."""

from __future__ import annotations

import ast
import os
import py_compile
from pathlib import Path

import pytest

from rans.archives import read_arrays
from rans.errors import ConfigError
from rans.evaluation.compare.optima import flights
from rans.evaluation.fly.exported import code_of
from rans.files import (
    open_regular,
    read_bytes,
    read_json,
    read_json_lines,
    read_text,
)
from tests.support.sources import sources
from tests.support.written_files import optimal_folder

READERS = {
    "rans.files": "reads bytes, texts and JSON",
    "rans.archives": "reads archives and arrays, from streams of rans.files",
    "rans.system": "opens files for rans.files, as the system can",
}
"""Modules that open files of strangers, and what they do with them."""

CALLS = {
    "open": "a file",
    "read_text": "a file",
    "read_bytes": "a file",
    "json.load": "JSON",
    "json.loads": "JSON",
    "tomllib.load": "TOML",
    "tomllib.loads": "TOML",
    "np.load": "arrays",
    "np.loadtxt": "arrays",
    "np.genfromtxt": "arrays",
    "np.fromfile": "arrays",
    "np.memmap": "arrays",
    "ZipFile": "an archive",
    "torch.load": "a pickle",
    "pickle.load": "a pickle",
    "pickle.loads": "a pickle",
    "cloudpickle.load": "a pickle",
    "cloudpickle.loads": "a pickle",
    "load_file": "safetensors",
    "safe_open": "safetensors",
    "InferenceSession": "ONNX",
    "load_from_zip_file": "an archive of pickles",
    "spec_from_file_location": "code",
    "exec": "code",
    "ET.parse": "XML",
    "ET.fromstring": "XML",
    "ET.iterparse": "XML",
}
"""Ends of the names of functions that read what may be a stranger's."""

ENDS = {call.rpartition(".")[2] for call in CALLS}

ALLOWED = {
    ("rans_proof.claims", "json.loads"): "the checkers' own reader, with bounds of its own",
    ("rans_proof.claims", "tomllib.loads"): "the same",
    ("rans_proof.pose_flights", "json.loads"): "a certificate that the checker has accepted",
    ("rans.structure", "tomllib.loads"): "the one parser of TOML, after a check of its effort",
    (
        "rans.processes",
        "read_bytes",
    ): "this process's own pickle, in a folder that only its user can read",
    ("rans.processes", "cloudpickle.loads"): "the same",
    ("rans.executors", "cloudpickle.loads"): "on a worker: calls of the user's own machine",
    (
        "rans.evaluation.fly.object_policy",
        "cloudpickle.loads",
    ): "another process of this session sent it",
    (
        "rans.evaluation.fly.foreign_policy",
        "InferenceSession",
    ): "ONNX Runtime opens networks by itself",
    (
        "rans_proof.network",
        "InferenceSession",
    ): "of bytes that the reader of the module has accepted",
    ("rans.evaluation.fly.foreign_policy", "load_from_zip_file"): "a pickle, with --trust only",
    (
        "rans.evaluation.fly.foreign_policy",
        "pickle.loads",
    ): "statistics of a policy, with --trust only",
    ("rans.evaluation.fly.exported", "exec"): "agent.py, with --trust only, from its text",
    ("rans.compile.cuda.kernel_cache", "read_bytes"): "the user's own cache, with a digest",
    ("rans.cli", "open"): "the null device",
    ("rans.registry", "read_text"): "files of installed packages, beside their code",
    ("rans.lazy", "read_text"): "the source of a module of RANS itself",
    ("rans.deploy.c.files", "json.loads"): "the contract that this process has just made",
    ("rans_robot.fmu.export", "json.loads"): "the same",
    ("rans_any_craft.importers", "ET.fromstring"): "robots, after a check for entities",
    ("rans.cli.train", "json.loads"): "the user types it",
    ("rans.cli.sweep", "json.loads"): "the user types it",
}
"""Other calls, and why each may be."""

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


def test_files_are_opened_by_the_readers_alone() -> None:
    used = set()
    for name, file in sources():
        if name in READERS:
            continue
        used |= {(name, call) for call in opens(file.read_text("utf-8"))}
    assert used - ALLOWED.keys() == set(), "use rans.files or rans.archives"
    assert ALLOWED.keys() - used == set(), "an exception that no module needs"


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
def test_what_would_be_seen(text: str) -> None:
    assert opens(text)


@pytest.mark.parametrize("name", ["optimal.json", "optimal.npz", "spacecraft.toml"])
@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_an_optimal_folder_leads_nowhere_else(name: str, kind: str, tmp_path: Path) -> None:
    folder = optimal_folder(tmp_path)
    (folder / name).rename(tmp_path / "secret")
    if kind == "link":
        (folder / name).symlink_to(tmp_path / "secret")
    else:
        os.mkfifo(folder / name)
    with pytest.raises(
        ConfigError, match="symbolic link" if kind == "link" else "it is not a file"
    ):
        flights(folder)


def test_what_is_trusted_is_the_text_that_lies_there(tmp_path: Path) -> None:
    """A `__pycache__` beside it, which nobody reads, would be imported in its place."""
    file = tmp_path / "agent.py"
    file.write_text("value = 'evil'\n")
    unchecked = py_compile.PycInvalidationMode.UNCHECKED_HASH
    py_compile.compile(str(file), invalidation_mode=unchecked)
    assert list((tmp_path / "__pycache__").iterdir())
    file.write_text("value = 'mine'\n")
    assert code_of(file).value == "mine"
    file.write_text("import sys\nsys.exit(0)\n")
    with pytest.raises(ConfigError, match="cannot be loaded: SystemExit"):
        code_of(file)


def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    bounded = lambda x: read_bytes(x, 1)  # noqa: E731
    for read in (open_regular, read_json, read_text, read_json_lines, bounded, read_arrays):
        for place in (pipe, tmp_path, Path("/dev/zero")):
            with pytest.raises(
                ConfigError, match="it is not a file, but a folder, a pipe or a device"
            ):
                read(place)
