"""The agents that come with RANS are small and complete; how they fly is in test_recorded.py."""

import re
import shutil
from importlib.util import find_spec

import pytest

from rans.base.errors import EXTRAS, MissingPackage
from rans.base.pretrained import (
    FOLDER,
    FOR_ANY_CRAFT,
    PACKAGE,
    agent_recipes,
    missing_agents,
    pretrained_card,
    pretrained_folder,
    pretrained_names,
)
from rans.cli import help
from rans.evaluation.fly.contestants import contestant
from rans.fast.agent_files.agent import read_policy
from tests.support.crafts import REAL_CRAFT
from tests.support.processes import ROOT

every_agent = pytest.mark.parametrize("name", pretrained_names())


@every_agent
def test_an_agent_is_small_and_complete(name):
    files = {file.name: file.stat().st_size for file in pretrained_folder(name).iterdir()}
    assert files.keys() == {"agent.safetensors", "config.json", "spacecraft.toml", "card.json"}
    card = pretrained_card(name)
    found = contestant(f"pretrained:{name}")
    # Its actor's weights are there once, those for each value of a trade-off too, and nothing else of their size.
    saved = read_policy(pretrained_folder(name) / "agent.safetensors")
    sets = [saved.network.tensors, *(saved.network.at or {}).values()]
    weights = sum(x.numel() for tensors in sets for x in tensors.values())
    assert not any(x.any() for key, x in sets[0].items() if key.startswith("value_net."))
    # Besides, a config.json that lists every world of the training.
    assert sum(files.values()) < 4 * weights + 60_000
    assert (card["name"], card["spacecraft"]) == (name, found.craft.name)
    crafts = "|".join(f"-{craft}" for craft in REAL_CRAFT)
    kinds = f"(-thrifty|-shared|-faults-shared|-robust|-faults|-trade-off|-atmos|{crafts})?"
    if saved.network.architecture.authority:
        assert name == f"any-craft-{found.craft.dimension}d"
        return
    assert re.fullmatch(
        rf"{card['task'].removesuffix('-priced')}-{found.craft.dimension}d{kinds}", name
    )


def test_every_agent_has_a_recipe_and_is_in_one_distribution():
    """The recipes name the agents of both; a checkout has both."""
    core = {file.name for file in FOLDER.iterdir()}
    others = {file.name for file in (ROOT / "agents" / PACKAGE).iterdir() if file.is_dir()}
    others.discard("__pycache__")
    assert len(core) == 6
    assert not core & others
    assert pretrained_names() == sorted(core | others)
    # The programs that trained the agents for any craft have left.
    assert agent_recipes() == sorted((core | others) - set(FOR_ANY_CRAFT.values()))
    assert missing_agents() == []


def test_the_core_has_the_agents_of_commands_that_a_newcomer_types():
    """The examples of `rans COMMAND --help`, the demo and the check of the packages need no extra for agents."""
    texts = [
        str(vars(help)),
        *((ROOT / name).read_text("utf-8") for name in ("Makefile", "README.md")),
    ]
    named = set(re.findall(r"(?:pretrained:|load_agent\(\")([a-z0-9-]+)", "".join(texts)))
    assert len(named) > 2
    # `make release` tries this agent to see that it is missing.
    assert named - {"dock-port-2d"} <= {file.name for file in FOLDER.iterdir()}


def test_without_the_second_distribution(monkeypatch, ran):
    """Six agents are left; any other is a sentence with the command that installs it."""
    monkeypatch.setattr("rans.base.pretrained.PACKAGE", "rans_agents_of_nobody")
    monkeypatch.setitem(EXTRAS, "rans_agents_of_nobody", "agents")
    assert len(pretrained_names()) == 6
    assert len(missing_agents()) == len(agent_recipes()) - 4
    with pytest.raises(
        MissingPackage, match=r"^The agent avoid-2d needs .* pip install .*/agents$"
    ):
        contestant("pretrained:avoid-2d")
    with pytest.raises(MissingPackage):
        contestant("avoid-2d")
    assert contestant("go-to-pose-3d").controller.name == "go-to-pose-3d"
    assert f"21 more agents: python -m pip install {ROOT / 'agents'}" in ran("list agents")


def test_an_agent_of_the_core_has_precedence(tmp_path, monkeypatch):
    """Another package's folder adds agents, and replaces none; nothing in it is imported."""
    package = tmp_path / "rans_agents_of_somebody"
    shutil.copytree(FOLDER / "land-3d", package / "land-3d")
    shutil.copytree(FOLDER / "land-3d", package / "mine")
    (package / "__init__.py").write_text("raise AssertionError\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("rans.base.pretrained.PACKAGE", package.name)
    assert find_spec(package.name) is not None
    assert pretrained_folder("mine") == package / "mine"
    assert pretrained_folder("land-3d") == FOLDER / "land-3d"


def test_both_distributions_have_one_version():
    core = (ROOT / "pyproject.toml").read_text("utf-8")
    agents = (ROOT / "agents/pyproject.toml").read_text("utf-8")
    version = re.compile(r'^version = "(.+?)"', re.MULTILINE)
    (number,) = version.findall(core)
    assert version.findall(agents) == [number]
