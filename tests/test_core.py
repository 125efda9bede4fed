"""RANS without any of its extras: the core works alone, and a missing package is a sentence."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rans.errors import EXTRAS, MissingPackage, is_installed, require
from tests.support.processes import PATIENCE, ROOT, python

BLOCK = """
import importlib.abc, sys

class Blocked(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in sys.argv[1].split(","):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocked())
"""
RUN = (
    BLOCK
    + """
from rans.cli import main
sys.exit(main(sys.argv[2:]))
"""
)
TINY = (
    "--set ppo.n_envs=8 --set ppo.n_steps=4 --set ppo.batch_size=16 --set timing.episode_steps=20 "
    "--total-timesteps 64"
)


def said(code: str, *arguments: str, folder: Path) -> tuple[int, str]:
    """Exit code and output of a program in a process of its own."""
    with python("-c", code, *arguments, cwd=folder) as process:
        out, errors = process.communicate(timeout=PATIENCE)
    return process.returncode, out + errors


def test_the_core_works_alone(tmp_path: Path) -> None:
    """Training, evaluation, exports, a page that flies, environments; each extra is blocked."""
    code = (
        BLOCK
        + f"""
import gymnasium, numpy, rans
from rans.cli import main
for line in (
    "train go-to-pose {TINY} --run run",
    "evaluate run --episodes 4",
    "export run --output agent --episodes 4 --margins 0",
    "export run --format numpy --output numpy --episodes 4 --margins 0",
    "export run --format c --output c --episodes 4 --margins 0",
    "view run --page page.html",
    "evaluate lqr:go-to-pose-2d --episodes 2",
):
    assert main(line.split()) == 0, line
environment = gymnasium.make("rans/GoToPose2D-v0")
observation, _ = environment.reset(seed=0)
assert numpy.isfinite(environment.step(environment.action_space.sample())[0]).all()
engine = rans.Engine("floating-platform", "go-to-pose", num_envs=8)
engine.reset(seed=0)
rans.PPO(engine, n_steps=4).learn(32).save("trained.safetensors")
"""
    )
    code_of_exit, text = said(code, ",".join(EXTRAS), folder=tmp_path)
    assert code_of_exit == 0, text
    assert "pip install 'rans[cpu]'" in text
    assert (tmp_path / "page.html").stat().st_size > 10_000
    assert not (tmp_path / "run/tensorboard").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "command"),
    [
        ("pydrake", "evaluate lqr:go-to-pose-2d --engine drake --episodes 2"),
        ("pydrake", "view go-to-pose-2d"),
        ("pydrake", "validate --quick"),
        ("casadi", "optimal go-to-pose"),
        ("casadi", "evaluate mpc:go-to-pose-2d --episodes 2"),
        ("clarabel", "optimal dock"),
        ("numba", "optimal go-to-pose --certify --certify-seconds 0.1"),
        ("matplotlib", "report ."),
        ("matplotlib", "stress go-to-pose-2d --episodes 2"),
        ("stable_baselines3", "export go-to-pose-2d --format sb3 --output out --margins 0"),
        ("onnx", "export go-to-pose-2d --format onnx --output out --margins 0"),
        ("tensorboard", f"train go-to-pose {TINY} --log hparams"),
    ],
)
def test_a_missing_package_is_a_sentence(module: str, command: str, tmp_path: Path) -> None:
    code, text = said(RUN, module, *command.split(), folder=tmp_path)
    assert code == 2, text
    assert "Traceback" not in text
    assert f"pip install 'rans[{EXTRAS[module]}]'" in " ".join(text.split())


def test_extras_install_what_they_are_for() -> None:
    """The names of modules and of packages differ; every extra of the table is one of pyproject.toml."""
    packages = {
        "PIL": "pillow",
        "pydrake": "drake",
        "zenoh": "eclipse-zenoh",
        "flint": "python-flint",
    }
    text = (ROOT / "pyproject.toml").read_text("utf-8")
    for module, extra in EXTRAS.items():
        declared = re.search(rf"^{extra} = \[(.*?)\]", text, re.MULTILINE | re.DOTALL)
        assert declared is not None, extra
        package = packages.get(module, module.replace("_", "-"))
        assert f'"{package}' in declared[1], module
    core = re.search(r"^dependencies = \[(.*?)^\]", text, re.MULTILINE | re.DOTALL)
    assert core is not None
    assert len(re.findall(r'^  "', core[1], re.MULTILINE)) <= 10


def test_what_is_missing_is_an_import_error_too() -> None:
    assert is_installed("json")
    assert not is_installed("no_such_module")
    assert require("json").dumps([]) == "[]"
    assert issubclass(MissingPackage, ImportError)
