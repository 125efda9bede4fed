"""The command line's manners: one sentence and an exit code, whatever is typed."""

from __future__ import annotations

import io
import os
import re
import select
import subprocess
import sys
import warnings
from collections import deque
from contextlib import redirect_stdout
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

import pytest

import rans_command
from rans import ConfigError, cli
from rans.base.files import read_text, write_text
from rans.cli import main
from tests.support.command_codes import code_of


class Broken:
    """A command that ends in an exception."""

    def __init__(self, error: BaseException) -> None:
        self.error = error

    def run(self) -> int:
        raise self.error


def broken(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    monkeypatch.setattr(cli, "_parse", lambda _: Broken(error))
    monkeypatch.setattr("rans.base.files._written", deque())  # by tests before


def test_letters_that_the_output_does_not_know():
    """As where PYTHONIOENCODING is ascii: 95 % intervals have a sign that it lacks."""
    printed = subprocess.run(
        [sys.executable, "-m", "rans", "list", "atmos"],
        check=True,
        capture_output=True,
        env=os.environ | {"PYTHONIOENCODING": "ascii"},
    )
    assert b"atmos" in printed.stdout
    assert b"?" in printed.stdout
    assert printed.stderr == b""


@pytest.mark.parametrize(
    ("option", "kind"),
    [
        ("train --seed", "a whole number"),
        ("assure x --failure-below", "a number"),
        ("compare x --certified", "a whole number"),
    ],
)
def test_what_is_no_number(option, kind, capsys):
    """None or not, one or many: told in our words, without Python's types and functions."""
    assert code_of([*option.split(), "x1"]) == 2
    said = " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert f"it must be {kind}, got 'x1'." in said
    assert not re.search(r"literal|convert|instantiated|class|parse for", said)


@pytest.mark.parametrize("arguments", [["--help"], ["evaluate", "--help"], ["list"], ["--version"]])
def test_an_output_that_is_no_file(arguments):
    """As where a program collects what is printed."""
    collected = io.StringIO()
    with redirect_stdout(collected):
        assert code_of(arguments) == 0
    assert collected.getvalue()


@pytest.mark.parametrize("arguments", [["--help"], ["list"]])
def test_no_output_at_all(arguments, monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)
    assert code_of(arguments) == 0


def shell(line: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """What a line of Bash does, in which $RANS is the command."""
    known = {"RANS": f"{sys.executable} -P -m rans", "PYTHONPATH": str(Path(__file__).parents[2])}
    return subprocess.run(
        ["bash", "-c", line],
        cwd=folder,
        capture_output=True,
        check=False,
        env=os.environ | known | environment,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("$RANS --help >&-", 0),
        ("$RANS list >&- 2>&- <&-", 0),
        ("$RANS evalute >&- 2>&-", 2),
    ],
)
def test_closed_streams(line, code, tmp_path):
    done = shell(line, tmp_path)
    assert (done.returncode, done.stderr) == (code, b"")


@pytest.mark.slow
def test_a_file_does_not_take_the_place_of_the_closed_output(tmp_path):
    done = shell("$RANS list floating-platform --picture craft.svg >&-", tmp_path)
    assert done.returncode == 0
    assert ElementTree.parse(tmp_path / "craft.svg").getroot().tag.endswith("svg")


@pytest.mark.slow
def test_folders_of_other_letters_where_python_is_told_ascii(tmp_path):
    """Drake does not load there."""
    done = shell(
        "$RANS validate --quick --layer thrusters --output é", tmp_path, LC_ALL="C", PYTHONUTF8="0"
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert (tmp_path / "é" / "validation.json").exists()


def test_a_folder_of_bytes_that_are_no_letters(tmp_path):
    """Pages tell their names, in UTF-8."""
    folder = tmp_path / "b\udce9"
    folder.mkdir()
    write_text(folder / "page.html", f"<h1>{folder.name}</h1>")
    assert read_text(folder / "page.html") == "<h1>b\\udce9</h1>"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["compare", "x"], True),
        (["list"], True),
        (["train", "--help"], False),
        (["help", "train"], False),
        (["--version"], False),
        (["version"], False),
        ([], False),
    ],
)
@pytest.mark.parametrize("to", ["stdout", "stderr", "nothing"])
def test_on_a_terminal_the_command_says_that_it_loads(words, says, to, monkeypatch):
    """Before anything is imported; the first output replaces the line, which leaves nothing behind."""
    master, slave = os.openpty()
    with open(slave, "w", closefd=False) as terminal, open(slave, "w") as other:
        monkeypatch.setattr(sys, "stdout", other)
        monkeypatch.setattr(sys, "stderr", terminal)
        with rans_command.says_that_it_loads(words):
            begun = os.read(master, 4096).decode() if says else ""
            other.reconfigure(errors="replace")  # as `main` does; that is no output
            assert not select.select([master], [], [], 0.0)[0]
            if to != "nothing":
                for word in ("one", "two"):
                    getattr(sys, to).write(f"{word}\n")
                    getattr(sys, to).flush()
        terminal.write("end\n")
        terminal.flush()
        rest = ""
        while not rest.endswith("end\r\n"):
            rest += os.read(master, 4096).decode()
        monkeypatch.undo()
    os.close(master)
    assert begun == (f"rans {words[0]}: loading ..." if says else "")
    erased = f"\r{' ' * len(begun)}\r" if says else ""
    assert rest == erased + ("" if to == "nothing" else "one\r\ntwo\r\n") + "end\r\n"


def test_in_a_pipe_nothing_says_that_it_loads(capfd):
    with rans_command.says_that_it_loads(["train"]):
        sys.stdout.write("one")
    assert capfd.readouterr() == ("one", "")


def test_the_module_is_the_command():
    done = subprocess.run(
        [sys.executable, "-m", "rans", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"rans {version('rans')}\n"


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (
            ConfigError("the mass must be > 0 kg, got -1."),
            2,
            "rans: the mass must be > 0 kg, got -1.\n",
        ),
        (
            OSError(28, "No space left on device", "metrics.jsonl"),
            2,
            "rans: cannot write metrics.jsonl: the disk is full.\n",
        ),
        (
            PermissionError(13, "Permission denied", "metrics.jsonl"),
            2,
            "rans: the system refuses metrics.jsonl: Permission denied.\n",
        ),
        (
            RuntimeError("DefaultCPUAllocator: can't allocate memory:\nyou tried"),
            2,
            "rans: out of memory, a smaller batch may fit: DefaultCPUAllocator: can't allocate memory:.\n",
        ),
        (
            ConfigError("\x1b[31m" + "x" * 10**7),
            2,
            "rans: \\x1b[31m"
            + "x" * (2000 - 5)
            + f" ... (10,000,005 characters) ... {'x' * 2000}\n",
        ),
        (KeyboardInterrupt(), 130, "\nrans: interrupted; nothing was written.\n"),
    ],
)
def test_ends_with_a_sentence(error, code, said, monkeypatch, capsys):
    broken(monkeypatch, error)
    assert main(["list"]) == code
    out, err = capsys.readouterr()
    # Sentences of code that is not RANS's end with its place.
    assert (out, re.sub(r" \(test_main\.py, line \d+, in run\)", "", err)) == ("", said)


@pytest.mark.parametrize("code", [0, None, "no licence"])
def test_code_of_others_cannot_end_a_command_with_success(code, monkeypatch, capsys):
    broken(monkeypatch, SystemExit(code))
    assert main(["list"]) == 2
    assert f"ended the command (sys.exit({code!r}))" in capsys.readouterr().err


def test_a_mistake_of_ours_is_not_hidden(monkeypatch):
    for error in (
        ZeroDivisionError(),
        RuntimeError("shapes differ"),
        RuntimeError("Please use tensor.pin_memory() or allocate the tensor with pin_memory=True"),
    ):
        # Its code is in a file of the package: that of a test is a user's, whose mistakes end in a sentence.
        code = compile("def run(self): raise self.error", cli.__file__, "exec")
        known = {}
        exec(code, known)
        ours = type("Ours", (), {"run": known["run"], "error": error})
        monkeypatch.setattr(cli, "_parse", lambda _, made=ours: made())
        with pytest.raises(type(error)):
            main(["list"])


@pytest.mark.filterwarnings("default")
def test_a_warning_is_one_sentence(monkeypatch, capsys):
    class Warns:
        def run(self) -> int:
            warnings.warn("its thrusters\n  cannot turn \x1b[31mit.", stacklevel=2)
            return 0

        def following(self) -> tuple[str, ...]:
            return ()

    monkeypatch.setattr(cli, "_parse", lambda _: Warns())
    before = warnings.showwarning
    assert main(["list"]) == 0
    assert capsys.readouterr().err == "rans: warning: its thrusters cannot turn \\x1b[31mit.\n"
    assert warnings.showwarning is before


@pytest.mark.slow
@pytest.mark.parametrize(("line", "unbuffered"), [("--version", ""), ("list", "1")])
def test_a_reader_who_leaves_is_no_error(line, unbuffered):
    """As in ``rans list | head -1``, for output that Python buffers and for output that it does not.

    ``--version`` is printed by Python and ``list`` by Rich, which would end the process itself.
    """
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-m", "rans", line],
        stdout=writer,
        stderr=subprocess.PIPE,
        env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        check=False,
    )
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, b"")
