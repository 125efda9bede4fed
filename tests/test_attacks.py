"""What a stranger, or a slip, may put into files and options: one short sentence, and nothing hangs."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

import rans
from rans import TASKS
from rans.base.errors import ConfigError, brief
from rans.base.files import Lock, replace_file, write_text
from rans.model.spacecraft_file import spacecraft_text

ROOT = Path(__file__).parents[1]
PLATFORM_TEXT = spacecraft_text("floating-platform")


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RANS_TRUST", "")  # as --trust sets it for the rest of the process


LONG = "x" * 200_000


@pytest.mark.parametrize(
    ("old", "new", "end"),
    [
        ("mass = ", f"{LONG} = 1\nmass = ", "known are actuators, centre_of_mass, "),
        ("mass = ", f"mass = [{'1, ' * 100_000}1]\nnever = ", "characters)."),
        ("mass = ", f"mass = 1{'0' * 400}\nnever = ", "characters)."),
        ("dimension = ", f"dimension = 1{'0' * 400}\nnever = ", "characters)."),
        ("thrust_sharing = ", f'thrust_sharing = "{LONG}"\nnever = ', "characters)."),
    ],
)
def test_a_long_value_leaves_room_for_the_rest_of_the_sentence(refused, old, new, end):
    text = PLATFORM_TEXT if old in PLATFORM_TEXT else f"{old}\n{PLATFORM_TEXT}"
    changed = text.replace(old, new, 1).replace("never = ", "# ", 1)
    write_text(Path("long.toml"), changed)
    sentence = refused("list long.toml")
    assert end in sentence
    assert len(sentence) < 600


HUGE = "x" * 1_000_000


@pytest.mark.parametrize(
    "ask",
    [
        rans.load_spacecraft,
        rans.load_conditions,
        rans.load_task,
        rans.load_agent,
        lambda name: rans.load_spacecraft(f"{name}.toml"),
        lambda name: rans.load_agent(f"pretrained:{name}"),
        lambda name: rans.load_agent(f"lqr:go-to-pose-2d@{name}"),
        lambda name: rans.train("go-to-pose", device=name),
        lambda name: TASKS[f"{name}:{name}"],
    ],
    ids=[
        "spacecraft",
        "conditions",
        "task",
        "agent",
        "file",
        "pretrained",
        "craft of an agent",
        "device",
        "name in a file",
    ],
)
def test_sentences_stay_short_however_long_a_name_is(ask):
    with pytest.raises(ConfigError) as refused:
        ask(HUGE)
    assert len(str(refused.value)) < 5000


def test_what_is_short_is_shown_whole():
    assert brief([1, "a"]) == "[1, 'a']"
    assert brief("x" * 200) == "'" + "x" * 79 + " ... (202 characters)"


def test_a_spacecraft_of_thousands_of_thrusters(refused):
    head, _, first = PLATFORM_TEXT.partition("[[thruster]]")
    thruster = "[[thruster]]" + first.partition("[[thruster]]")[0]
    write_text(Path("many.toml"), head + thruster * 1001)
    assert "at most 1000 thrusters, got 1001" in refused("list many.toml")


def test_nothing_is_put_in_the_place_of_a_device(refused):
    """Root may: a drawing saved as /dev/null would have ended it for everybody."""
    os.mkfifo("odd.svg")
    said = refused("list floating-platform --picture odd.svg")
    assert "it is a pipe or a device" in said
    assert stat.S_ISFIFO(os.stat("odd.svg").st_mode)


@pytest.mark.parametrize(
    "row",
    [
        "[1]",
        "{}",
        '{"steps": "many", "seconds": 1, "success": 0}',
        '{"steps": 1, "seconds": 1, "success": 0, "return/position": {}}',
    ],
)
def test_metrics_that_say_nothing(trained, refused, row):
    shutil.copytree(trained, "run")
    Path("run/metrics.jsonl").write_text(row + "\n")
    for command in ("train --resume run", "export run --output agent --force"):
        assert "metrics.jsonl is damaged: line 1" in refused(command)


def test_a_task_of_pythons_own_library_is_not_imported(trained, refused):
    """A run folder may name any module as its task; one of these opens a browser when it is imported."""
    shutil.copytree(trained, "run")
    table = json.loads(Path("run/config.json").read_text())
    Path("run/config.json").write_text(json.dumps(table | {"task": "antigravity:Task"}))
    assert "would run that module's code" in refused("evaluate run")
    assert "it belongs to Python's library" in refused("evaluate run --trust")
    assert "antigravity" not in sys.modules


def test_a_lock_goes_with_its_holder_and_without_file_systems_that_have_none(tmp_path, monkeypatch):
    write_text(tmp_path / "file", "")
    first = Lock(tmp_path / "file")
    second = Lock(tmp_path / "file")
    first.take("taken")
    first.take("taken")
    with pytest.raises(ConfigError, match=r"^taken$"):
        second.take("taken")
    del first
    second.take("taken")

    def unsupported(*_):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(fcntl, "flock", unsupported)
    Lock(tmp_path / "file").take("taken")


def test_drafts_of_killed_processes_go(tmp_path):
    """Not those of the living, nor young ones: another machine's process may be at work."""
    with subprocess.Popen([sys.executable, "-c", ""]) as dead:
        pass
    names = (
        str(dead.pid),
        f"{dead.pid}.0123abcd",
        str(os.getppid()),
        f"{os.getppid()}.0123abcd",
        "x",
    )
    drafts = {name: tmp_path / f".{name}.policy.zip" for name in names}
    other = tmp_path / f".{dead.pid}.other.zip"
    for draft in (*drafts.values(), other):
        draft.write_text("half")
        os.utime(draft, (time.time() - 60, time.time() - 60))
    replace_file(tmp_path / "policy.zip", lambda draft: draft.write_text("whole"))
    assert [name for name in names if drafts[name].exists()] == list(names[2:])
    assert other.exists()
    drafts[str(dead.pid)].write_text("young")
    replace_file(tmp_path / "policy.zip", lambda draft: draft.write_text("whole"))
    assert drafts[str(dead.pid)].exists()


@pytest.mark.parametrize("distance", [1e2, 1e7])
@pytest.mark.filterwarnings("default:spacecraft 'floating-platform'. a thruster is:UserWarning")
def test_the_picture_of_a_spacecraft_fits_however_far_its_thrusters_are(ran, distance):
    head, _, tail = PLATFORM_TEXT.partition("position = [")
    write_text(Path("far.toml"), f"{head}position = [{distance}, {tail.partition(',')[2].lstrip()}")
    said = ran("list far.toml")
    assert len(said) < 10_000
    assert f"a thruster is {distance:.3g} m from the centre of mass" in said


@pytest.mark.parametrize(
    "command",
    ["list \x1b[31m", "optimal go-to-pose --objective \x9b2J", "\x1b[2J"],
)
def test_options_do_not_command_the_terminal(refused, command):
    sentence = refused(command)
    assert "has control characters" in sentence
    assert "\x1b" not in sentence
