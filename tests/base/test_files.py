import contextlib
import errno
import math
import os
import stat
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from rans import ConfigError, RansWarning
from rans.base import files
from rans.base.files import (
    append_text,
    distinct,
    environment,
    first_line,
    git_revision,
    inside,
    inside_for_others,
    number,
    read_bytes,
    read_json,
    read_json_lines,
    read_text,
    ready_folder,
    replace_file,
    write_json,
    write_text,
    writing_at_end,
)
from tests.support.processes import PATIENCE, ROOT, python


def test_a_file_is_replaced_as_a_whole(tmp_path):
    file = tmp_path / "new" / "folder" / "x.txt"
    write_text(file, "old")
    seen = []

    def write(draft):
        draft.write_text("half")
        seen.append(file.read_text())
        draft.write_text("new ä")

    replace_file(file, write)
    assert (seen, file.read_text("utf-8")) == (["old"], "new ä")
    assert os.listdir(file.parent) == ["x.txt"]


@pytest.mark.parametrize(
    "error",
    [OSError(28, "No space left on device"), RuntimeError("write failed"), KeyboardInterrupt()],
)
def test_a_failed_write_leaves_the_old_file(tmp_path, error):
    file = tmp_path / "x.txt"
    write_text(file, "old")

    def write(draft):
        draft.write_text("half")
        raise error

    expected = KeyboardInterrupt if isinstance(error, KeyboardInterrupt) else ConfigError
    with pytest.raises(expected) as caught:
        replace_file(file, write)
    if expected is ConfigError:
        assert str(file) in str(caught.value)
        cause = (
            "the disk is full." if isinstance(error, OSError) else "write failed (is the disk full"
        )
        assert cause in str(caught.value)
    assert file.read_text() == "old"
    assert os.listdir(tmp_path) == ["x.txt"]


def test_nobody_can_foresee_a_draft(tmp_path):
    """It is a new file of its own before anything is written, with the permissions of any other file."""
    drafts = []

    def write(draft):
        assert stat.S_ISREG(draft.lstat().st_mode)
        assert draft.parent == tmp_path
        drafts.append(draft)

    replace_file(tmp_path / "x.txt", write)
    replace_file(tmp_path / "x.txt", write)
    assert len(set(drafts)) == 2
    usual = tmp_path / "usual"
    usual.touch()
    assert (tmp_path / "x.txt").stat().st_mode == usual.stat().st_mode


def test_links_are_not_followed(tmp_path):
    outside = tmp_path / "outside.txt"
    outside.write_text("mine")
    folder = tmp_path / "run"
    folder.mkdir()
    for name in (f".{os.getpid()}.x.txt", "x.txt", "log.txt"):
        (folder / name).symlink_to(outside)
    write_text(folder / "x.txt", "new")
    assert not (folder / "x.txt").is_symlink()
    with pytest.raises(ConfigError, match=r"cannot write .*log\.txt"):
        append_text(folder / "log.txt", "more")
    assert outside.read_text() == "mine"


def test_a_place_inside_a_folder(tmp_path):
    """The folder itself may be a link, nothing below it, not even one that leads nowhere."""
    folder = tmp_path / "run"
    (folder / "plain").mkdir(parents=True)
    (folder / "link").symlink_to(tmp_path)
    (folder / "plain" / "dangling").symlink_to(tmp_path / "nowhere")
    (tmp_path / "short").symlink_to(folder)
    assert inside(tmp_path / "short", "plain", "x") == tmp_path / "short" / "plain" / "x"
    assert inside_for_others(folder, "new") == folder / "new"
    for parts in (("link",), ("link", "x"), ("plain", "dangling")):
        with pytest.raises(ConfigError, match="is a symbolic link"):
            inside(folder, *parts)
    with pytest.raises(ConfigError, match="dangling is a symbolic link"):
        inside_for_others(folder, "plain")


ADDER = """
import sys
from pathlib import Path
from rans.base.files import one_at_a_time, read_json, write_json
file = Path(sys.argv[1])
print("ready", flush=True)
sys.stdin.readline()
for number in range(40):
    with one_at_a_time(file.parent):
        known = read_json(file) if file.exists() else []
        write_json(file, [*known, f"{sys.argv[2]} {number}"])
"""


def test_who_extends_a_file_loses_nothing_of_others(tmp_path):
    """Of two processes that begin at once."""
    file = tmp_path / "known.json"
    with contextlib.ExitStack() as stack:
        adders = [
            stack.enter_context(
                python(
                    "-c",
                    ADDER,
                    str(file),
                    name,
                    stdin=subprocess.PIPE,
                    env=os.environ | {"PYTHONPATH": str(ROOT)},
                )
            )
            for name in ("a", "b")
        ]
        for adder in adders:
            assert adder.stdout is not None
            assert adder.stdout.readline() == "ready\n"
        for adder in adders:
            assert adder.stdin is not None
            adder.stdin.write("\n")
            adder.stdin.flush()
        assert [adder.wait(PATIENCE) for adder in adders] == [0, 0]
    assert sorted(read_json(file)) == sorted(f"{name} {k}" for name in "ab" for k in range(40))


def test_names_that_differ_have_files_that_differ():
    """What comes with the package keeps its plain name."""
    assert distinct("lab") == "lab"
    names = [
        distinct("lab"),
        distinct("lab", "a"),
        distinct("lab", "b"),
        distinct("a/b"),
        distinct("a-b"),
    ]
    assert len(set(names)) == len(names)
    assert not any("/" in name for name in names)
    assert distinct("lab", "a") == distinct("lab", "a")


def test_a_folder_is_made_ready_before_the_work(tmp_path):
    wanted = tmp_path / "runs" / "new"
    assert ready_folder(wanted) == wanted
    assert not wanted.parent.exists()  # work that fails leaves no empty folder
    wanted.mkdir(parents=True)
    assert ready_folder(wanted).is_dir()
    (tmp_path / "file").write_text("")
    for impossible in (tmp_path / "file", tmp_path / "file" / "runs"):
        with pytest.raises(ConfigError, match=r"cannot write into .*file.*; name another folder"):
            ready_folder(impossible)


@pytest.mark.parametrize(
    "command",
    [
        "optimal go-to-pose --episodes 4 --output file",
        "benchmark --quick --output file/x.json",
    ],
)
def test_long_work_does_not_begin_without_a_place_for_its_results(command, here, refused):
    (here / "file").write_text("")
    assert "cannot write into file" in refused(command)


def test_json_has_texts_for_what_is_not_finite(tmp_path):
    """Wherever they are; and null, which files had before, was an infinity."""
    file = tmp_path / "x.json"
    far = math.inf
    write_json(
        file, {"a": (far, -far, 1.5), "b": [{"c": math.nan}], "d": np.float64(far), "e": None}
    )
    read = read_json(file)
    assert read == {"a": ["inf", "-inf", 1.5], "b": [{"c": "nan"}], "d": "inf", "e": None}
    assert [number(x) for x in read["a"]] == [far, -far, 1.5]
    assert number(read["e"]) == far
    assert math.isnan(number(read["b"][0]["c"]))


def test_one_process_at_a_time_flies_for_a_file(tmp_path):
    file = tmp_path / "new" / "compare.json"
    with (
        writing_at_end(file.parent.stat, file),
        pytest.raises(ConfigError, match="another process"),
    ):
        writing_at_end(tmp_path.stat, file).__enter__()
    assert not file.parent.exists()


def test_results_of_another_command_are_kept(tmp_path, monkeypatch):
    file = tmp_path / "compare.json"
    for name in ("compare.html", "compare-bounds.json", "episodes.npz"):
        (tmp_path / name).touch()
    (tmp_path / "stress").mkdir()
    for value in ({"command": "first"}, {"about": {"command": "first"}, "again": True}):
        write_json(file, value, beside=())
    with pytest.warns(RansWarning, match="earlier"):
        write_json(file, {"command": "second"}, beside=["episodes.npz", "none", "stress"])
    [kept] = (tmp_path / "earlier").iterdir()
    assert read_json(kept / "compare.json")["again"]
    assert {one.name for one in kept.iterdir()} == {
        "compare.html",
        "compare.json",
        "episodes.npz",
        "stress",
    }

    # What cannot be written leaves the earlier results where they are.
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "")

    with monkeypatch.context() as disk:
        disk.setattr(Path, "write_text", full)
        with pytest.raises(ConfigError, match="disk is full"):
            write_json(file, {"command": "third"}, beside=())
    assert read_json(file)["command"] == "second"
    file.write_text("damaged")
    write_json(file, {"command": "third"}, beside=())


def test_json_lines(tmp_path):
    file = tmp_path / "x.jsonl"
    with pytest.raises(ConfigError, match=r"cannot read .*x\.jsonl"):
        read_json_lines(file)
    for content, expected in (
        (b"", []),
        (b'{"a": 1}\n{"a": 2}\n', [{"a": 1}, {"a": 2}]),
        (b'{"a": 1}\n{"a":', [{"a": 1}]),
        (b"{}\n\xff\xfe\n{}\n", [{}]),
        (b"{}\n" + b"[" * 100_000, [{}]),
    ):
        file.write_bytes(content)
        assert read_json_lines(file) == expected


def test_first_line():
    assert first_line(ValueError("Too bad.\nTry again.")) == "Too bad"
    assert first_line(EOFError()) == "EOFError"


@pytest.mark.parametrize(
    ("told", "name"),
    [
        (
            "vendor_id\t: Acme\nmodel name\t: Acme Quick 7: two of it\nmodel name\t: Acme Slow 1\n",
            "Acme Quick 7: two of it",
        ),
        ("processor\t: 0\nCPU implementer\t: 0x41\n", "unknown"),
    ],
)
def test_the_processors_name(monkeypatch, told, name):
    """As Linux tells it of the first core."""
    read = Path.read_text

    def reading(file, *rest, **more):
        return told if file.name == "cpuinfo" else read(file, *rest, **more)

    monkeypatch.setattr(Path, "read_text", reading)
    assert environment()["processor"] == name


def test_what_the_environment_says_is_so(monkeypatch):
    """Of what other modules know as well; a package that is not there is said to be missing."""
    monkeypatch.setattr(files, "_PACKAGES", ("numpy", "no-such-package"))
    known = environment()
    assert (known["numpy"], known["no-such-package"]) == (np.__version__, "not installed")
    assert known["python"] == ".".join(map(str, sys.version_info[:3]))
    assert known["system"] == f"{os.uname().sysname} {os.uname().machine}"


def test_the_revision_is_of_a_checkout_of_rans_alone(tmp_path, monkeypatch):
    """Not of a repository round a virtual environment, whose settings would name a program to run."""
    run = partial(subprocess.run, cwd=tmp_path, check=True, capture_output=True)
    run(["git", "init"])
    run(["git", "-c", "user.name=a", "-c", "user.email=a@b", "commit", "--allow-empty", "-m", "a"])
    run(["git", "config", "core.fsmonitor", f"touch {tmp_path}/ran;"])
    installed = tmp_path / ".venv/lib/site-packages"
    for folder in (installed / "rans", tmp_path / "rans"):
        folder.mkdir(parents=True)
        (installed / "rans_command.py").touch()
        monkeypatch.setattr("rans.base.system.PACKAGE_FOLDER", folder)
        assert git_revision() == "unknown"
    (tmp_path / "rans_command.py").touch()
    assert len(git_revision()) == 7
    assert not (tmp_path / "ran").exists()
    monkeypatch.setenv("PATH", "")
    assert git_revision() == "unknown"


def test_json_that_is_deep_is_told(tmp_path):
    """Python's reader manages 900 levels, but whoever walks through them may not."""
    for depth in (60, 900):
        text = "[" * depth + "]" * depth
        write_text(tmp_path / "deep.json", text)
        write_text(tmp_path / "deep.jsonl", f'{{"deep": {text}}}\n')
        if depth == 60:
            read_json(tmp_path / "deep.json")
            read_json_lines(tmp_path / "deep.jsonl")
        else:
            with pytest.raises(ConfigError, match=r"deep\.json: .* at most 64 deep"):
                read_json(tmp_path / "deep.json")
            with pytest.raises(ConfigError, match=r"deep\.jsonl, line 1: .* at most 64 deep"):
                read_json_lines(tmp_path / "deep.jsonl")


@pytest.mark.parametrize("read", [read_json, read_json_lines, read_text])
def test_files_that_are_larger_than_any_are_not_read(tmp_path, read):
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(2**40)  # which takes no room on the disk
    with pytest.raises(
        ConfigError, match=r"huge has 1,099,511,627,776 bytes, and at most [\d,]+ are read"
    ):
        read(tmp_path / "huge")


def test_a_file_without_a_size_is_read_as_far_as_it_may_be(tmp_path):
    """Such as those of /proc, which say that they are empty."""
    assert Path("/proc/self/maps").stat().st_size == 0
    assert len(read_bytes(Path("/proc/self/maps"), 2**20)) > 100
    with pytest.raises(ConfigError, match="and at most 100 are read"):
        read_bytes(Path("/proc/self/maps"), 100)


def test_a_file_names_the_command_or_the_function_that_made_it(monkeypatch):
    """Whatever the arguments of the process are, a call from Python has no command."""
    monkeypatch.setattr("sys.argv", ["rans", "stress", "my run"])
    assert files.made_by("rans.stress") == "rans.stress"
    with files.as_command():
        assert files.made_by("rans.stress") == "rans stress 'my run'"
    assert files.made_by("rans.stress") == "rans.stress"
