"""README's commands, and those that they print to run next, on the bare core and with each extra alone."""

from __future__ import annotations

import json
import re
from zlib import crc32

import pytest

from rans.base.errors import EXTRAS, installing
from tests.support.hidden_modules import ran

README = (
    "init own.toml --from floating-platform",
    "list own.toml",
    "train go-to-pose --spacecraft own.toml --output runs/my-agent",
    "evaluate runs/my-agent",
    "compare own.toml",
    "report runs/my-agent",
    "view runs/my-agent --play --save fly.html",
)
"""Commands of README and of an own spacecraft, in a user's order."""
PROMISED = {
    "optimal": (
        "optimal go-to-pose --objective time --start 1 0 10deg --certify --certify-seconds 1 --output o",
        "compare own.toml --with mpc --episodes 1 --certified 0",
    ),
    "video": ("view go-to-pose-2d --episodes 1 --save f.gif",),
    "onnx": (
        "export go-to-pose-2d --format onnx --output onnx",
        "evaluate onnx:onnx/agent.onnx:go-to-pose-2d --episodes 2",
    ),
    "verify": ("view go-to-pose-2d --episodes 1 --save f.png",),
}
"""What docs/install.md says an extra is for, as far as commands go."""
BROUGHT = {"optimal": {"llvmlite"}, "verify": {"matplotlib", "PIL"}, "video": {"PIL"}}
"""Modules that packages of an extra bring: numba, Drake, and Pillow."""
TINY = (
    "--set ppo.n_envs=8 --set ppo.n_steps=4 --set ppo.batch_size=16 --set timing.episode_steps=20 "
    "--set total_timesteps=64"
)
SHORTER = {
    "train": TINY,
    "evaluate": "--episodes 2",
    "compare": "--episodes 2 --certified 0",
    "stress": "--episodes 2 --only latency",
    "view": "--save replay.html",
    "export": "--episodes 64 --force",
    "assure": "--episodes 20",
    "benchmark": "floating-platform --quick",
    "validate": "--quick --layer thrusters",
}
"""Options with which commands take seconds."""


def shortened(line: str) -> str:
    """A command line with the options of `SHORTER`, and a folder of its own for a training."""
    name = line.split()[0]
    if name == "train" and "--resume" in line:
        return line
    line = re.sub(r" --(quick|(episodes|certified|total-timesteps|quality) \S+)", "", line)
    if name == "train" and "--output" not in line:  # a folder with a training is refused
        line += f" --output runs/{crc32(line.encode())}"
    options = SHORTER.get(name, "")
    return line if "--save" in line else f"{line} {options}"


def printed_next(text: str) -> list[str]:
    """Commands under "Next:" in what a command prints, shortened."""
    lines = re.findall(r"^  (?:rans )?(.*)$", text.partition("Next:\n")[2], re.MULTILINE)
    return [shortened(line.partition("   # ")[0]) for line in lines]


@pytest.mark.slow
@pytest.mark.parametrize("alone", PROMISED)
def test_an_extra_alone_does_what_the_page_promises(alone, tmp_path):
    hidden = {module for module, extra in EXTRAS.items() if extra not in (alone, "agents")}
    hidden -= BROUGHT.get(alone, set())
    lines = [README[0], *PROMISED[alone]]
    for line, code, text in ran(lines, hidden, tmp_path):
        assert code == 0, f"{line}\n{text}"
    if alone == "optimal":
        found = json.loads((tmp_path / "o/optimal.json").read_text("utf-8"))
        assert found["starts"][0]["sentence"] == "solved, not flown"
        assert found["bounds"]


@pytest.mark.slow
@pytest.mark.parametrize("alone", ["", "optimal", "plots", "verify"])
def test_commands_do_what_they_can_with_an_extra_alone(alone, tmp_path):
    """All of README end well; so do those printed under "Next:", or they say what is to be installed.

    The other extras change none of these commands.
    """
    hidden = {module for module, extra in EXTRAS.items() if extra not in (alone, "agents")}
    following = {}  # an ordered set
    for line, code, text in ran([shortened(line) for line in README], hidden, tmp_path):
        assert code == 0, f"{line}\n{text}"
        following |= dict.fromkeys(printed_next(text))
    assert following
    for line, code, text in ran([*following], hidden, tmp_path):
        said = " ".join(text.split())
        lacks = any(installing(extra) in said for extra in EXTRAS.values())
        assert code == 0 or (code == 2 and lacks), f"{line}\n{text}"
        assert "Traceback" not in text


@pytest.mark.slow
@pytest.mark.parametrize("hidden", ["matplotlib", "casadi"])
def test_a_comparison_writes_its_numbers_without_a_package(hidden, tmp_path):
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
