"""Files that readers copy whole: each runs alone, from another folder, and does what it says."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

from tests.support.processes import ROOT, printed

FOLDER = ROOT / "examples" / "single_file"


def ran(name: str, place: Path, *options: str) -> str:
    """What a copy of a file prints in an empty folder."""
    file = FOLDER / name
    (place / file.name).write_text(file.read_text())
    return printed(file.name, *options, cwd=place)


def solved(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"solved ([\d.]+)", text)]


@pytest.mark.slow
def test_ppo_in_one_file_learns(tmp_path):
    """A quarter of its steps: episodes that succeed were none at first."""
    lines = ran("ppo.py", tmp_path, "--steps", "800000", "--device", "cpu").splitlines()
    rates = [float(re.findall(r"([\d.]+)% of", line)[0]) for line in lines if "% of" in line]
    assert rates[0] < 20.0
    assert rates[-1] > 60.0
    assert len((FOLDER / "ppo.py").read_text().splitlines()) <= 350


@pytest.mark.slow
def test_a_controller_of_ones_own_flies_beside_lqr(tmp_path):
    own, _ = solved(ran("controller.py", tmp_path))
    assert own > 95.0


@pytest.mark.slow
def test_a_task_of_ones_own_is_learnt(tmp_path):
    assert solved(ran("task.py", tmp_path))[0] > 90.0


@pytest.mark.slow
def test_a_learner_of_ones_own_learns(tmp_path):
    assert solved(ran("../plugin/rans_example/learner.py", tmp_path))[0] > 30.0


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("jax") is None, reason="jax is not installed")
def test_a_policy_in_jax_flies_on_shared_memory(tmp_path):
    [rate] = re.findall(r"([\d.]+)% of 4,096", ran("jax_policy.py", tmp_path))
    assert float(rate) > 95.0
