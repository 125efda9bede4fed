"""README's commands, and those that they print to run next, on the bare core and with each extra alone."""

from __future__ import annotations

import re
from pathlib import Path
from zlib import crc32

import pytest

from rans.errors import EXTRAS, installing
from tests.support.processes import PATIENCE, python

BLOCK = """
import importlib.abc, sys
import torch._dynamo  # it asks for onnx, and takes a refusal by a finder for an error

class Blocked(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in sys.argv[1].split(","):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocked())
"""
"""Hides modules, named in the first argument, from the process."""
RUN_EACH = (
    BLOCK
    + """
import shlex, webbrowser
import rans.evaluation.compare.entrants
from rans.cli import main
sys.stdout = sys.stderr
rans.evaluation.compare.entrants.swept = lambda *_: []  # curves for pages, which take seconds
webbrowser.open = lambda *_, **__: True
for line in sys.argv[2:]:
    print("$", line, flush=True)
    print("code of exit:", main(shlex.split(line)), flush=True)
"""
)
"""Runs commands, and prints each one's code of exit after what it says."""
README = (
    "init own.toml --from atmos",
    "list own.toml",
    "train go-to-pose --spacecraft own.toml --output runs/first",
    "evaluate runs/first",
    "compare own.toml",
    "report runs/first",
    "view runs/first --play --save fly.html",
)
"""Commands of README and of an own spacecraft, in a user's order."""
SHORTER = {
    "train": "--set ppo.n_envs=8 --set ppo.n_steps=4 --set ppo.batch_size=16 --set timing.episode_steps=20 "
    "--set total_timesteps=64",
    "evaluate": "--episodes 2",
    "compare": "--episodes 2 --certified 0",
    "stress": "--episodes 2 --only latency",
    "view": "--save replay.html",
    "export": "--episodes 64",
}
"""Options with which commands take seconds."""


def shortened(line: str) -> str:
    """A command line with the options of `SHORTER`, and a folder of its own for a training."""
    name = line.split()[0]
    if name == "train" and "--resume" in line:
        return line
    line = re.sub(r" --(episodes|certified|total-timesteps|quality) \S+", "", line)
    if name == "train" and "--output" not in line:  # a folder with a training is refused
        line += f" --output runs/{crc32(line.encode())}"
    options = SHORTER.get(name, "")
    return line if "--save" in line else f"{line} {options}"


def ran(lines: list[str], hidden: set[str], folder: Path) -> list[tuple[str, int, str]]:
    """Each command with its code of exit and what it printed, in one process."""
    with python("-c", RUN_EACH, ",".join(sorted(hidden)), *lines, cwd=folder) as process:
        _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, said
    parts = re.split(r"^\$ ", said, flags=re.MULTILINE)[1:]
    found = [re.fullmatch(r"(.*?)\n(.*)code of exit: (\d+)\n", part, re.DOTALL) for part in parts]
    assert len(found) == len(lines)
    return [(one[1], int(one[3]), one[2]) for one in found if one]


@pytest.mark.slow
@pytest.mark.parametrize("alone", ["", *sorted({*EXTRAS.values()} - {"agents"})])
def test_commands_do_what_they_can_with_an_extra_alone(alone: str, tmp_path: Path) -> None:
    """All of README end well; so do those printed under "Next:", but for what their comment says is to install."""
    hidden = {module for module, extra in EXTRAS.items() if extra not in (alone, "agents")}
    following: dict[str, str] = {}
    for line, code, text in ran([shortened(line) for line in README], hidden, tmp_path):
        assert code == 0, f"{line}\n{text}"
        for printed in re.findall(r"^  rans (.*)$", text.partition("Next:\n")[2], re.MULTILINE):
            command, _, comment = printed.partition("   # ")
            following[shortened(command)] = comment
    assert following
    if alone not in ("", "optimal", "plots", "verify"):  # the others change none of these
        return
    for line, code, text in ran([*following], hidden, tmp_path):
        lacks = following[line].removeprefix("first: ") if "first: " in following[line] else ""
        assert code == (2 if lacks else 0), f"{line}\n{text}"
        assert lacks in " ".join(text.split()), text
        assert lacks == "" or lacks in {*map(installing, EXTRAS.values())}
        assert "Traceback" not in text


@pytest.mark.slow
@pytest.mark.parametrize("hidden", ["matplotlib", "casadi"])
def test_a_comparison_writes_its_numbers_without_a_package(hidden: str, tmp_path: Path) -> None:
    """It says what is missing before anybody flies; what the user asks for by name is refused there."""
    line = f"compare go-to-pose-2d --with lqr {SHORTER['compare']} --output found"
    asked = line.replace("lqr", "mpc")
    (_, code, text), (_, refused, sentence) = ran([line, asked], {hidden}, tmp_path)
    assert code == 0, text
    assert (tmp_path / "found/compare.json").exists()
    page = (tmp_path / "found/compare.html").read_text("utf-8")
    assert ("<img" in page) is (hidden != "matplotlib")
    assert (installing("plots") in page.replace("&#39;", "'")) is (hidden == "matplotlib")
    assert refused == (2 if hidden == "casadi" else 0)
    assert ("starts of seed" in sentence) is (hidden != "casadi")
