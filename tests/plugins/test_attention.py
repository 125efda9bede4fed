"""Attention over effectors: commands follow their effectors, and one set of weights flies many crafts."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from rans_attention.study import begun, train

from rans.cli import main
from rans.deploy.export import Form, write_agent
from rans.deploy.program import agent_program
from rans.errors import ConfigError
from rans.fast.agent_files.agent import SavedPolicy, read_policy
from rans.fast.flights import Flights
from rans.fast.learn.config import PPOSettings
from rans.model.actuators import Throttle
from rans.model.spacecraft import Spacecraft
from rans.policy.backbone_registry import BACKBONES
from rans.policy.backbones import Dense, effector_tokens
from rans.policy.network import Network
from rans.policy.parts import NetworkView
from tests.support import plugins
from tests.support.engines import PLATFORM
from tests.support.kernel_flights import policy, setup
from tests.support.processes import ROOT
from tests.support.training import scatter

plugins.register()


def attending(craft: Spacecraft, head: str = "on-off") -> Network:
    return policy(
        craft, sided=False, backbone="attention", tokens=effector_tokens(craft), head=head
    )


@pytest.mark.parametrize("head", ["on-off", "gaussian", "gated"])
def test_a_command_follows_its_effector(head: str) -> None:
    order = [3, 1, 0, 2, 7, 6, 5, 4]
    moved = replace(PLATFORM, thrusters=tuple(PLATFORM.thrusters[i] for i in order))
    one = attending(PLATFORM, head)
    other = Network(replace(one.architecture, tokens=effector_tokens(moved)), one.tensors)
    generator = torch.Generator().manual_seed(2)
    rows = torch.randn(500, one.architecture.layout.width, generator=generator)
    found, expected = (network.deterministic_action(rows, None)[0] for network in (other, one))
    # Sums over effectors in another order, which may turn a choice that is close.
    assert ((found - expected[:, order]).abs() > 1e-5).double().mean() < 1e-2
    assert expected.std(dim=1).mean() > 0.01


def test_members_compute_what_each_computes_alone() -> None:
    networks = [scatter(attending(PLATFORM), seed) for seed in (1, 2)]
    given = networks[0].architecture
    both = Network.stacked(
        given, [one.member(0) for one in networks], torch.device("cpu"), torch.float32
    )
    rows = torch.randn(2, 30, given.layout.width)
    found = both.deterministic_action(rows.flatten(0, 1), None)[0].unflatten(0, (2, -1))
    for network, own, commands in zip(networks, rows, found, strict=True):
        assert (network.deterministic_action(own, None)[0] != commands).double().mean() < 1e-2


def test_executors_that_do_not_know_it_leave_it_to_torch() -> None:
    network = attending(PLATFORM)
    assert Flights(network, setup(PLATFORM)).fly(0, 20, 1).ways == {"stepping, cpu"}


class Doubled(Dense):
    """A backbone that torch alone computes."""

    is_traced = False

    def outputs(self, network: NetworkView, features: torch.Tensor) -> torch.Tensor:
        return 2.0 * super().outputs(network, features)


def test_a_backbone_of_a_stranger_is_flown_by_torch_and_refused_by_files(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What it commands is its own, not that of the layers that it resembles."""
    own = {**vars(BACKBONES)["_own"], "doubled": Doubled()}  # until the end of this test
    monkeypatch.setattr(BACKBONES, "_own", own)
    throttled = replace(PLATFORM, actuators=Throttle())
    network = policy(throttled, backbone="doubled", sided=False)
    usual = Network(replace(network.architecture, backbone="dense"), network.tensors)
    with pytest.raises(ConfigError, match="the backbone 'doubled'"):
        agent_program(network)
    found, other = (Flights(one, setup(throttled)).fly(0, 20, 1) for one in (network, usual))
    assert (found.ways, other.ways) == ({"stepping, cpu"}, {"CPU, float32"})
    # Machine code and torch agree to 1e-5 where they fly the same.
    assert found.sums["impulse"].mean != pytest.approx(other.sums["impulse"].mean, rel=0.01)


def test_one_iteration_reaches_every_weight_of_every_layout() -> None:
    """Weights learnt on one layout move to the next."""
    learners = begun(2)
    before = {name: x.detach().clone() for name, x in learners[0].network.tensors.items()}
    rewards = train(learners, 1)
    assert np.isfinite(rewards).all()
    after = learners[1].network.tensors
    unmoved = [
        name for name in learners[0].network.learnt if torch.equal(before[name], after[name])
    ]
    assert not [name for name in unmoved if not name.startswith("value_net")]


@pytest.mark.parametrize("form", ["rans", "sb3"])
def test_files_hold_it(form: Form, tmp_path: Path) -> None:
    network = attending(PLATFORM)
    write_agent(tmp_path, form, SavedPolicy(network, {}, 0, {}, 0.0), PPOSettings(), "A policy")
    name = "agent.safetensors" if form == "rans" else "policy.zip"
    again = read_policy(tmp_path / name).network
    assert again.architecture.tokens == network.architecture.tokens
    rows = torch.randn(20, network.architecture.layout.width)
    assert torch.equal(*(one.deterministic_action(rows, None)[0] for one in (network, again)))


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
def test_a_training_of_the_package_flies_and_needs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its entry point gives the name; without the package, training and agent say what to install."""
    folder = str(tmp_path / "run")
    train_it = [
        "train",
        "go-to-pose",
        "--set",
        "ppo.backbone=attention",
        "--total-timesteps",
        "512",
    ]
    for setting in ("n_envs=32", "n_steps=8", "batch_size=256", "symmetric=false", "layers=[8]"):
        train_it += ["--set", f"ppo.{setting}"]
    without = {name: x for name, x in vars(BACKBONES)["_own"].items() if name != "attention"}
    monkeypatch.setattr(BACKBONES, "_own", without)
    metadata = tmp_path / "rans_attention-0.1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: rans-attention\nVersion: 0.1.0\n"
    )
    project = tomllib.loads((ROOT / "examples/plugins/attention/pyproject.toml").read_text("utf-8"))
    [(group, names)] = project["project"]["entry-points"].items()
    lines = [f"[{group}]", *(f"{name} = {value}" for name, value in names.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines))
    with monkeypatch.context() as installed:
        installed.syspath_prepend(tmp_path)
        installed.delitem(vars(BACKBONES), "_offered", raising=False)
        assert main([*train_it, "--device", "cpu", "--output", folder]) in (0, 1), (
            capsys.readouterr()
        )
        assert BACKBONES.package("attention") == "rans-attention"
        assert main(["evaluate", folder, "--episodes", "8"]) in (0, 1), capsys.readouterr()
    monkeypatch.delitem(vars(BACKBONES), "_offered")
    monkeypatch.setattr(BACKBONES, "_loaded", {})
    capsys.readouterr()
    assert main(train_it) == 2
    assert "attention is a plug-in: pip install" in capsys.readouterr().err
    assert main(["evaluate", folder, "--episodes", "8"]) == 2
    assert "attention is a plug-in: pip install" in capsys.readouterr().err
