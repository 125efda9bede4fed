"""RANS without any of its extras: the core works alone, and a missing package is a sentence."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import rans.base.errors
from rans.base.errors import EXTRAS, MissingPackage, installing, is_installed, require
from tests.support.hidden_modules import BLOCK, ran
from tests.support.processes import PATIENCE, ROOT, python

TINY = (
    "--set ppo.n_envs=8 --set ppo.n_steps=4 --set ppo.batch_size=16 --set timing.episode_steps=20 "
    "--set total_timesteps=64"
)

WITHOUT_POSIX = """
import errno, fcntl, os, shutil, signal, subprocess, sys, types

def locking(descriptor, mode, count):
    assert (mode, count) == (msvcrt.LK_NBLCK, 1)
    try:
        flock(descriptor, LOCKED)
    except BlockingIOError:
        raise PermissionError(errno.EACCES, "Permission denied") from None

flock, LOCKED = fcntl.flock, fcntl.LOCK_EX | fcntl.LOCK_NB
msvcrt = sys.modules["msvcrt"] = types.ModuleType("msvcrt")
msvcrt.LK_NBLCK, msvcrt.locking = 2, locking

def opened(file, flags, mode=0o777, *, dir_fd=None, open_file=os.open):
    assert not os.path.isdir(file), "Windows opens no folders"
    return open_file(file, flags, mode, dir_fd=dir_fd)

def kill(process, number, send=os.kill):
    assert number != 0, "on Windows this is Ctrl-C"
    send(process, number)

os.open, os.kill, shutil._use_fd_functions = opened, kill, False
everywhere = {"O_APPEND", "O_CREAT", "O_EXCL", "O_RDONLY", "O_RDWR", "O_TRUNC", "O_WRONLY"}
everywhere |= {"SIGABRT", "SIGFPE", "SIGILL", "SIGINT", "SIGSEGV", "SIGTERM"}
everywhere |= {"SIGKILL"}  # Python's own modules send it on this system
alone = {"fork", "forkpty", "getpgid", "getuid", "geteuid", "killpg", "mkfifo", "nice", "pread", "pwrite"}
alone |= {"setpgid", "setsid", "statvfs", "alarm", "pause", "setitimer", "getitimer", "sigwait"}
for module in (os, signal):
    for name in set(dir(module)) - everywhere:
        beginnings = "O_", "SIG", "ITIMER", "pthread_", "sched_"
        if name in alone or name.startswith(beginnings) and not name.startswith(("SIG_DFL", "SIG_IGN")):
            delattr(module, name)
os.environ["USERNAME"] = "user"  # as Windows always has it; torch names its cache by it
for name in ("fcntl", "grp", "pwd", "resource", "termios"):
    sys.modules.pop(name, None)
"""
"""What Windows lacks, or has otherwise, is away; its locks, which the file's opening holds, are this system's."""


def said(code: str, *arguments: str, folder: Path) -> tuple[int, str]:
    """Exit code and output of a program in a process of its own."""
    with python("-c", code, *arguments, cwd=folder) as process:
        out, errors = process.communicate(timeout=PATIENCE)
    return process.returncode, out + errors


@pytest.mark.slow
def test_notebooks_show_values_with_plots_alone(tmp_path):
    """What examples/notebook displays needs no package of optimal control."""
    code = (
        BLOCK
        + """
import rans
agent = rans.load_agent("go-to-pose-2d")
flight = agent.fly(start=rans.state((1.0, 0.0)), goal=rans.state((0.0, 0.0)))
for value in (rans.load_spacecraft("floating-platform"), agent, agent.evaluate(episodes=2), flight):
    assert "<" in value._repr_html_()
"""
    )
    plots = ("matplotlib", "PIL", "tensorboard")
    code_of_exit, text = said(code, ",".join(EXTRAS.keys() - {*plots}), folder=tmp_path)
    assert code_of_exit == 0, text


@pytest.mark.skipif(sys.platform == "win32", reason="Windows itself has nothing of POSIX")
@pytest.mark.slow
def test_the_core_needs_no_extra_and_nothing_of_posix(tmp_path):
    """Training, evaluation, exports, pages, environments, locks, another process and the command's end.

    README's commands without any extra are run in `tests.test_extras`.
    """
    code = (
        WITHOUT_POSIX
        + BLOCK
        + f"""
from pathlib import Path
import gymnasium, numpy, rans
from rans.cli import main
from rans.base.errors import ConfigError
from rans.base.files import Lock, append_text, read_bytes, replace_file
from rans.base.processes import Processes
for line in (
    "train go-to-pose {TINY} --output run",
    "evaluate run --episodes 4",
    "export run --output agent --episodes 4 --force",
    "export run --format numpy --output numpy --episodes 4 --force",
    "export run --format c --output c --episodes 4 --force",
    "view run --play --save page.html",
    "assure run --episodes 20",
):
    assert main(line.split()) == 0, line
environment = gymnasium.make("rans/GoToPose2D-v0")
observation, _ = environment.reset(seed=0)
assert numpy.isfinite(environment.step(environment.action_space.sample())[0]).all()

first, second = Lock(Path("lock")), Lock(Path("lock"))
first.take("free")
try:
    second.take("held")
    raise AssertionError("two hold a lock")
except ConfigError as error:
    assert str(error) == "held"
first.release()
second.take("free")

Path("outside").write_text("mine")
Path("link").symlink_to("outside")
try:
    append_text(Path("link"), "more")
    raise AssertionError("a link was followed")
except ConfigError:
    assert Path("outside").read_text() == "mine"
assert read_bytes(Path("link"), 100) == b"mine"

abandoned = Path(f".{{os.getpid()}}.01234567.file")
abandoned.touch()
os.utime(abandoned, (0, 0))
replace_file(Path("file"), lambda draft: draft.write_text("new"))
assert not abandoned.exists()

with Processes(1) as pool:
    assert pool.submit(abs, -7).result() == 7

import rans_command
sys.argv = ["rans", "list"]
rans_command.run()
"""
    )
    blocked = ("fcntl", "grp", "pwd", "resource", "termios", *EXTRAS)
    code_of_exit, text = said(code, ",".join(blocked), folder=tmp_path)
    assert code_of_exit == 0, text
    assert "[fast]" in text
    assert "fail again in NumPy" in text
    assert "fail again in Drake" not in text
    assert (tmp_path / "page.html").stat().st_size > 10_000
    assert not (tmp_path / "run/tensorboard").exists()


MISSING = [
    [
        ("pydrake", "evaluate lqr:go-to-pose-2d --engine drake --episodes 2"),
        ("casadi", "optimal go-to-pose"),
        ("casadi", "evaluate mpc:go-to-pose-2d --episodes 2"),
        ("numba", "optimal go-to-pose --certify"),
        ("onnx", "export go-to-pose-2d --format onnx --output out"),
        ("onnxruntime", "evaluate onnx:agent.onnx:go-to-pose-2d --episodes 2"),
        ("stable_baselines3", "evaluate sb3:agent.zip:go-to-pose-2d --trust --episodes 2"),
        ("rans_agents", "evaluate pretrained:dock-port-2d --episodes 2"),
        ("rans_agents", "view go-to-pose-2d-robust"),
        ("rans_agents", "list go-to-pose-2d-robust"),
    ],
    [("pydrake", "validate --quick")],
    [("clarabel", "optimal dock")],
]
"""Modules, and commands that need them before anything else that is not of the core, a process each."""


@pytest.mark.slow
@pytest.mark.parametrize("missing", MISSING, ids=lambda missing: missing[0][0])
def test_a_missing_package_is_a_sentence(missing, tmp_path):
    """A process imports torch for seconds, so that one lacks several modules and runs several commands."""
    hidden = {module for module, _ in missing}
    results = ran([line for _, line in missing], hidden, tmp_path)
    for (module, _), (line, code, sentence) in zip(missing, results, strict=True):
        assert code == 2, line
        assert "Traceback" not in sentence, line
        assert installing(EXTRAS[module]) in " ".join(sentence.split()), line


def test_extras_install_what_they_are_for():
    """The names of modules and of packages differ; every extra of the table is one of pyproject.toml."""
    packages = {
        "PIL": "pillow",
        "pydrake": "drake",
        "zenoh": "eclipse-zenoh",
        "flint": "python-flint",
    }
    text = (ROOT / "pyproject.toml").read_text("utf-8")
    for module, extra in EXTRAS.items():
        if extra == "agents":  # a folder
            continue
        declared = re.search(rf"^{extra} = \[(.*?)\]", text, re.MULTILINE | re.DOTALL)
        assert declared is not None, extra
        package = packages.get(module, module.replace("_", "-"))
        assert f'"{package}' in declared[1], module
    core = re.search(r"^dependencies = \[(.*?)^\]", text, re.MULTILINE | re.DOTALL)
    assert core is not None
    assert len(re.findall(r'^  "', core[1], re.MULTILINE)) <= 10


def test_what_is_missing_is_an_import_error_too():
    assert is_installed("json")
    assert not is_installed("no_such_module")
    assert require("json").dumps([]) == "[]"
    assert issubclass(MissingPackage, ImportError)


@pytest.mark.parametrize("extra", sorted({*EXTRAS.values()} - {"agents"}))
def test_what_installs_an_extra_names_no_distribution_of_ours(extra, tmp_path, monkeypatch):
    """From a checkout its path; else third parties alone, as no index has RANS and anybody may take its name."""
    assert installing(extra) == f"python -m pip install -e '{ROOT}[{extra}]'"
    monkeypatch.setattr(rans.base.errors, "CHECKOUT", tmp_path)
    words = shlex.split(installing(extra))
    assert words[:4] == ["python", "-m", "pip", "install"]
    assert len(words) > 4
    for word in words[4:]:
        assert not word.startswith("rans")
        assert Requirement(word).extras == set()
        assert "extra" not in word
