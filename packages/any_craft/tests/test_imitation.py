"""A training that begins from the agent for any craft: imitation of its commands, then reinforcement learning."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from rans_any_craft import imitation
from rans_any_craft.allocated import demand
from rans_any_craft.frugality import numbers_of

from rans import ConfigError
from rans.api.training import from_any_craft
from rans.evaluation.fly import choice
from rans.fast.agent_files.agent import read_policy
from rans.fast.learn import graph
from rans.fast.learn.config import MemorySettings, TrainConfig, training
from rans.fast.learn.policy_file import teacher
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer
from rans.model.spacecraft_file import load_spacecraft
from rans.policy.network import Network
from rans.randomization.conditions_file import load_conditions


def config(task: str = "go-to-pose", craft: str = "floating-platform", **ppo: Any) -> TrainConfig:
    base = training(task, craft, "cpu")
    sizes: dict[str, Any] = {"n_envs": 64, "n_steps": 16, "batch_size": 256, "layers": (32, 32)}
    changes: dict[str, Any] = {"begin_from": "pretrained:any-craft-2d", "total_timesteps": 64 * 16}
    return replace(base, ppo=replace(base.ppo, **(sizes | ppo)), **changes)


def trainer(folder: Path, given: TrainConfig) -> Trainer:
    return Trainer(given, load_spacecraft(given.spacecraft), RunFolder(folder))


def imitate(begun: Trainer) -> tuple[Any, Network]:
    """The expert, which the training's agent has imitated, and that agent before."""
    learner = begun.learner
    own = learner.network
    untrained = Network(
        own.architecture, {name: x.detach().clone() for name, x in own.tensors.items()}
    )
    expert = teacher("pretrained:any-craft-2d", begun.engine, learner.network.architecture)
    assert expert is not None
    losses: list[float] = []
    imitation.imitate(
        begun.engine,
        learner.network,
        learner.adam,
        expert,
        begun.config.ppo,
        lambda: False,
        report=lambda _, loss: losses.append(loss),
    )
    # Each round adds states that its own flights lead to, so that it need not fall.
    assert losses
    assert torch.tensor(losses).isfinite().all()
    return expert, untrained


def shorten(monkeypatch: pytest.MonkeyPatch, rounds: int, updates: int) -> None:
    monkeypatch.setattr(imitation, "_ROUNDS", rounds)
    monkeypatch.setattr(imitation, "_OWN_ROUNDS", 1)
    monkeypatch.setattr(imitation, "_MOST_ROUNDS", rounds + 1)
    monkeypatch.setattr(imitation, "_UPDATES", updates)


@pytest.mark.parametrize(
    "craft", ["floating-platform", pytest.param("roboran-platform", marks=pytest.mark.slow)]
)
def test_its_commands_are_met(craft, tmp_path, monkeypatch):
    """Also with the symmetries of the platform, where thrusters are numbered as the goal is ahead."""
    shorten(monkeypatch, rounds=3, updates=60)
    begun = trainer(tmp_path, config(craft=craft))
    engine = begun.engine
    learner = begun.learner.network
    expert, untrained = imitate(begun)
    seen = engine.observe()
    with torch.no_grad():
        asked, before, after = (
            one.deterministic_action(seen, None)[0] for one in (expert, untrained, learner)
        )
    assert (asked - after).abs().mean() < 0.4 * (asked - before).abs().mean()
    assert (engine.elapsed() == 0).all()
    # PPO begins with an optimizer that has not moved.
    state = begun.learner.adam.state()
    assert not any(state[name].any() for name in ("first", "second", "steps"))
    assert (state["rate"] == begun.config.ppo.learning_rate).all()


def test_what_it_demands_is_met_where_valves_share_a_supply(tmp_path, monkeypatch):
    """In states of its own flights."""
    shorten(monkeypatch, rounds=3, updates=60)
    begun = trainer(tmp_path, config(craft="floating-platform-shared", backbone="allocated"))
    learner, engine = begun.learner.network, begun.engine
    expert, untrained = imitate(begun)
    missed = []
    with torch.no_grad():
        for _ in range(30):
            seen = engine.observe()
            asked, before, after = (
                demand(one, one.features(one.look(one.in_body(seen))[0])[0])
                for one in (expert, untrained, learner)
            )
            missed.append(((after - asked).abs().sum(), (before - asked).abs().sum()))
            engine.step(engine.commands(learner.deterministic_action(seen, None)[0]))
    after, before = (sum(x) for x in zip(*missed, strict=True))
    assert after < 0.6 * before


def test_reinforcement_learning_goes_on_from_demands(tmp_path):
    """PPO changes the layer that demands, and an agent's file flies as the network does."""
    given = config(craft="floating-platform-shared", backbone="allocated")
    begun = trainer(tmp_path / "run", replace(given, begin_from=None))
    before = begun.learner.network.tensors["action_net.weight"].detach().clone()
    begun.train(lambda _: None)
    network = begun.learner.network
    assert (network.tensors["action_net.weight"] - before).abs().max() > 1e-4
    saved = read_policy(RunFolder(tmp_path / "run").agent_file).network
    seen = begun.engine.observe()
    with torch.no_grad():
        own, read = (one.deterministic_action(seen, None)[0] for one in (network, saved))
    assert torch.equal(own, read)


def test_ways_with_a_price_of_their_own_are_not_imitated_by_demands(tmp_path):
    """From 0.75 on, where flights are long enough: those of 32 s are, and those of 25 s are not."""
    given = config(craft="floating-platform-shared", backbone="allocated")
    begun = trainer(tmp_path, replace(given, begin_from=None))
    architecture = begun.learner.network.architecture
    steps = begun.engine.timing.episode_steps
    for value, flown in (("0.4", 160), ("0.75", 160), ("0.9", steps)):
        begun.engine.timing = replace(begun.engine.timing, episode_steps=flown)
        made = teacher(f"pretrained:any-craft-2d#{value}", begun.engine, architecture)
        assert made is not None
        assert numbers_of(made.architecture).price == 1.0
    begun.engine.timing = replace(begun.engine.timing, episode_steps=160)
    with pytest.raises(ConfigError, match=r"at 0\.9 and in flights of 32 s .* at most 0\.75"):
        teacher("pretrained:any-craft-2d#0.9", begun.engine, architecture)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_a_graph_replays_its_gradient_steps(tmp_path, monkeypatch):
    """On a GPU they are those of single operations, through rounds whose labels and step sizes differ."""
    shorten(monkeypatch, rounds=3, updates=20)
    weights = []
    for number, begins in enumerate((graph.graphed, lambda function, _: function)):
        monkeypatch.setattr(graph, "graphed", begins)
        begun = trainer(tmp_path / str(number), replace(config(), device="cuda"))
        learner = begun.learner.network
        expert = teacher("pretrained:any-craft-2d", begun.engine, learner.architecture)
        assert expert is not None
        adam = begun.learner.adam
        imitation.imitate(begun.engine, learner, adam, expert, begun.config.ppo, lambda: False)
        weights.append(learner.weights())
    for name, weight in weights[0].items():
        torch.testing.assert_close(weight, weights[1][name], rtol=1e-3, atol=1e-4)


def test_values_are_of_its_own_flights(tmp_path, monkeypatch):
    """The returns of the expert's flights teach nothing, and those of its own do."""
    shorten(monkeypatch, rounds=1, updates=4)
    monkeypatch.setattr(imitation, "_SECONDS", 1.6)
    flown = imitation._flown
    values = []
    # Planted errors in the returns: none, of the expert's flights, of its own.
    for number, wrong in enumerate([(0.0, 0.0), (1e3, 0.0), (0.0, 1.0)]):

        def planted(*arguments, wrong=wrong):
            labels = flown(*arguments)
            error = wrong[0] * (1.0 - labels.own) + wrong[1] * labels.own
            return labels._replace(returns=labels.returns + error)

        begun = trainer(tmp_path / str(number), config())
        monkeypatch.setattr(imitation, "_flown", planted)
        imitate(begun)
        with torch.no_grad():
            values.append(begun.learner.network.evaluate(begun.engine.observe()).value)
    torch.testing.assert_close(values[1], values[0], rtol=0.0, atol=0.0)
    assert (values[2] != values[0]).all()


def test_commands_of_pulsed_thrusters_spread_as_their_errors(tmp_path, monkeypatch):
    """PPO would fly at random if it began with the usual spread, a whole period of thrust."""
    shorten(monkeypatch, rounds=1, updates=80)
    monkeypatch.setattr(imitation, "_SECONDS", 1.6)
    begun = trainer(tmp_path, config(craft="freeflyer2"))
    imitate(begun)
    assert (begun.learner.network.tensors["log_std"] < -0.1).all()


def test_an_imitation_that_solves_the_task_is_all_of_a_training(tmp_path, monkeypatch):
    """It is judged after four rounds of its own, and here found to solve the task after eight."""
    monkeypatch.setattr(imitation, "_ROUNDS", 1)
    monkeypatch.setattr(imitation, "_UPDATES", 1)
    monkeypatch.setattr(imitation, "_SECONDS", 0.4)
    given = config()
    begun = trainer(tmp_path / "ends", given)
    found = iter([0.98, 1.0])
    monkeypatch.setattr(begun.selection, "judge", lambda: {"success": next(found)})
    rows = []
    begun.train(rows.append)
    assert begun.solved
    # One round that the expert flies and eight of its own, of two periods each.
    assert begun.steps == (1 + 8) * 2 * 64
    assert [row["success"] for row in rows] == [1.0]
    # A training without an end by its task goes on by reinforcement learning.
    steps = (1 + 4) * 2 * 64
    whole = replace(given, solved_share=None, total_timesteps=steps + 64 * 16)
    long = trainer(tmp_path / "long", whole)
    monkeypatch.setattr(long.selection, "judge", lambda: {"success": 1.0})
    long.train(lambda _: None)
    assert [row["steps"] for row in long.rows] == [steps, steps + 64 * 16]


def test_a_number_after_the_name_makes_it_save_thrust(tmp_path):
    begun = trainer(tmp_path, config())
    architecture = begun.learner.network.architecture

    def frugal(name: str) -> tuple[float, ...]:
        expert = teacher(f"pretrained:{name}", begun.engine, architecture)
        assert expert is not None
        return expert.architecture.frugal

    assert frugal("any-craft-2d") == ()
    # Starts are 3.5 m away in the mean.
    assert frugal("any-craft-2d#0.4")[:2] == (0.85, 3.5)
    with pytest.raises(ConfigError, match=r"imitates at 0.4"):
        frugal("any-craft-2d#1")
    # Demands are imitated of the weights of the value.
    architecture = replace(architecture, backbone="allocated")
    own, of_value = (
        teacher(f"pretrained:any-craft-2d{value}", begun.engine, architecture)
        for value in ("", "#0.4")
    )
    assert own is not None
    assert of_value is not None
    assert not torch.equal(*(one.tensors["action_net.weight"] for one in (own, of_value)))
    assert frugal("any-craft-2d#0.4") == ()
    for wrong in ("any-craft-2d#2", "any-craft-2d#much", "go-to-pose-2d#0.5"):
        with pytest.raises(ConfigError):
            frugal(wrong)


def test_a_training_as_it_comes_begins_from_it_where_it_flies(monkeypatch):
    platform = load_spacecraft("floating-platform")
    for value in (0.3, 0.4):
        flown = choice.Choice(value, 0.2, 256, 255, 6.0, 17.0)
        monkeypatch.setattr(choice, "chosen", lambda *_, flown=flown: flown)
        begun = from_any_craft(training("go-to-pose"), platform).begin_from
        # Networks that choose thrusters one by one imitate one value, or the agent as it was trained.
        assert begun == "pretrained:any-craft-2d" + "#0.4" * (value == 0.4)
    # Valves that share a supply are imitated together.
    shared = load_spacecraft("floating-platform-shared")
    backbones = [
        from_any_craft(training("go-to-pose", craft.name), craft).ppo.backbone
        for craft in (platform, shared)
    ]
    assert backbones == ["dense", "allocated"]
    space = load_spacecraft("free-flyer")
    others = [
        (training("track-velocity"), platform),
        (training("go-to-pose", "free-flyer"), space),
        (replace(training("go-to-pose"), conditions=load_conditions("lab")), platform),
    ]
    for given, craft in others:
        assert from_any_craft(given, craft) == given
    lost = choice.Choice(0.0, 0.2, 256, 250, 6.0, 17.0)
    monkeypatch.setattr(choice, "chosen", lambda *_: lost)
    assert from_any_craft(training("go-to-pose"), platform) == training("go-to-pose")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"memory": MemorySettings(4)}, "has a memory"),
        ({"task": "track-velocity"}, "observes something else"),
        ({"craft": "free-flyer"}, "observes something else"),
        ({"craft": "freeflyer2", "backbone": "allocated"}, "freeflyer2 has other effectors"),
    ],
)
def test_what_cannot_imitate_it_is_refused(given, said, tmp_path):
    with pytest.raises(ConfigError, match=said):
        trainer(tmp_path, config(**given))
