"""Names of strangers in the languages that RANS writes: they come out as text, and nothing of them is run."""

from __future__ import annotations

import ast
import json
import shutil
import subprocess
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_c_code.text import C

import rans
from rans import ConfigError, Timing
from rans.base.files import write_json
from rans.base.languages import Code, Python, Toml
from rans.base.pretrained import pretrained_folder
from rans.cli.next_commands import training
from rans.deploy.export import write_agent, write_export
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.fast.agent_files.agent import SavedPolicy
from rans.model.spacecraft import CommandRange, Spacecraft
from rans.model.spacecraft_draft import commented
from rans.model.spacecraft_file import load_spacecraft, parse_spacecraft, to_toml
from rans.policy.network import Network
from tests.support.exports import exported, shipped

HOSTILE = {
    "comment": "*/ int hostile(void) { return 7; } /*",
    "assembly": '*/ __asm__(".incbin \\"secret\\""); /*',
    "docstring": '"""\nraise SystemExit(7)\n"""',
    "backslash": "ends in \\",
    "trigraph": "*??/\n/ int hostile; ??/",
    "line": "one\nMETA_STOP\nSTATE = 1\n[propellant]\n#define int float",
    "script": "</script><script>hostile()</script>",
    "shell": "$(touch ran) `touch ran`; touch ran '\"",
    "invisible": "\u2028\u202e\x7f\x00\x1b[2J",
    "long": "x" * 10_000,
}
"""Ends of comments, texts, lines, elements and words of the languages that we write, and what is no name."""
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")


def each(*kinds: str) -> Any:
    """Names that may end a comment, a text or a line of a language."""
    names = {kind: HOSTILE[kind] for kind in kinds or HOSTILE}
    return pytest.mark.parametrize("name", names.values(), ids=names)


REFUSED = [name for name in HOSTILE.values() if len(name) > 100 or not name.isprintable()]


def planted(craft: Spacecraft, name: str) -> Spacecraft:
    """A craft that has the name all the same, as if a door had been forgotten; its wheel's command has it too."""
    craft = replace(craft, name="planted")
    object.__setattr__(craft, "name", name)
    *others, last = craft.commands
    object.__setattr__(craft, "commands", (*others, CommandRange(name, *last[1:])))
    return craft


@pytest.mark.parametrize("name", [*REFUSED, "", " ", 3])
def test_no_value_has_a_name_of_several_lines(name, tmp_path):
    """A spacecraft, in Python and in a file, an effector, and an agent in its card and its contract."""
    platform = load_spacecraft("floating-platform")
    with pytest.raises(ConfigError, match="name"):
        replace(platform, name=name)
    with pytest.raises(ConfigError, match="name"):
        parse_spacecraft(to_toml(planted(platform, name)), "a stranger's file")
    if isinstance(name, str) and name.strip():
        agent = tmp_path / "agent"
        shutil.copytree(pretrained_folder("go-to-pose-2d"), agent)
        card = json.loads((agent / "card.json").read_text("utf-8"))
        write_json(agent / "card.json", card | {"name": name})
        with pytest.raises(ConfigError, match=r"name in .*card\.json must be one line"):
            write_export(agent, tmp_path / "out", "rans", episodes=1)


@each()
def test_toml_has_the_name_as_text(name):
    craft = load_spacecraft("floating-platform")
    hostile = planted(craft, name)
    plain = to_toml(craft), commented(craft, ["from a craft"])
    for safe, text in zip(plain, (to_toml(hostile), commented(hostile, [name])), strict=True):
        assert tomllib.loads(text) == tomllib.loads(safe) | {"name": name}


@each("docstring", "backslash", "line", "invisible")
def test_python_has_the_name_as_text(name, tmp_path):
    saved = small()
    codes = []
    for title in ("agent", name):
        write_agent(tmp_path, "numpy", saved, title)
        module = ast.parse((tmp_path / "agent.py").read_text("utf-8"))
        codes.append(ast.dump(ast.Module(module.body[1:], [])))
    assert codes[0] == codes[1]
    assert exported(tmp_path)["Agent"]


def small() -> SavedPolicy:
    """An agent whose weights are quickly compiled."""
    given = replace(shipped("go-to-pose-2d")[0].architecture, layers=(4,))
    return SavedPolicy(Network(given, given.initial(0, 0.5)[0]), 0)


def contract_of(name: str) -> str:
    """A contract in which everything has the name."""
    column = {"name": name, "unit": name, "frame": name, "meaning": name}
    about = {
        "agent": name,
        "observation": [column | {"valid": [0, 1], "refused": [0, 1]}] * 10,
        "command": {"ranges": [{"name": name, "kind": name, "low": 0.0, "high": 1.0}] * 8},
        "readings": {"oldest": 1.0},
        "control_period": 0.2,
    }
    return json.dumps(about)


@needs_gcc
@each("comment", "assembly", "backslash", "trigraph", "line", "invisible")
def test_c_has_the_name_as_text(name, tmp_path):
    """As the title, and as names of columns and commands."""
    saved = small()
    write_agent(tmp_path, "c", saved, name, contract_of(name))
    assert strangers_code(tmp_path / "agent.c") == []


@needs_gcc
@each("comment", "script", "shell")
def test_an_fmu_has_the_name_as_text(name, tmp_path):
    """XML has no form for control characters, which the door refuses."""
    fmpy = pytest.importorskip("fmpy")
    saved = small()
    write_agent(tmp_path, "fmu", saved, name, contract_of(name))
    about = fmpy.read_model_description(str(tmp_path / "agent.fmu"))
    assert (about.modelName, about.description) == (name, name)
    assert {one.unit for one in about.modelVariables if one.unit} == {name}


@each("comment", "line", "invisible")
def test_an_ephemeris_has_the_name_as_text(name, tmp_path):
    """A foreign reader finds one object, and the states that were flown."""
    write_ccsds = pytest.importorskip("rans_missions.ccsds").write_ccsds
    ndm = pytest.importorskip("ccsds_ndm.ndm_io")
    script = pytest.importorskip("rans_missions.script").Script(np.zeros((3, 1, 6)))
    craft = load_spacecraft("vbar-chaser")
    task = rans.Hold()
    timing = Timing(control_period=100.0, episode_steps=3)
    flight = fly(craft, task, script, scenarios(task, craft, 1, 1), timing)
    object.__setattr__(flight, "craft", planted(craft, name))
    of_craft, *_ = write_ccsds(flight, tmp_path, 0, "2026-02-03T04:05:06", 51.6, 30.0, 90.0)
    segment = ndm.NdmIo().from_path(of_craft).body.segment[0]
    assert segment.metadata.ref_frame == "EME2000"
    assert len(segment.data.state_vector) == 4


def test_a_shell_has_the_name_as_text(tmp_path):
    for name in HOSTILE.values():
        if "\0" in name:  # no word of a command line has it
            continue
        (line,) = training(load_spacecraft("floating-platform"), name)
        done = subprocess.run(
            ["sh", "-c", line.replace("rans", "printf '%s\\n'", 1)],
            capture_output=True,
            text=True,
            check=True,
            cwd=tmp_path,
        )
        assert done.stdout == "\n".join(["train", "go-to-pose", "--spacecraft", name, ""])
    assert not list(tmp_path.iterdir())


def test_every_printer_asks_the_escaper():
    """A text without a type is escaped, that of another language too."""
    for language in (C, Python, Toml):
        assert language.of(language("*/ \\ \n")) == "*/ \\ \n"
        assert "\n" not in language.of("*/ \\ \n")
        assert "\n" not in language.of(Code("\n"))


def strangers_code(file: Path) -> list[str]:
    """Words of a stranger that C99 reads as code, with trigraphs as it has them; the file must compile."""
    compiled = ["gcc", "-std=c99", str(file)]
    done = subprocess.run([*compiled, "-fsyntax-only"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    code = subprocess.run([*compiled, "-E"], capture_output=True, text=True, check=True).stdout
    return [word for word in ("hostile", "incbin", "META_STOP", "xxxxxx") if word in code]
