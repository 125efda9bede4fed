"""Exports command what the agent does: networks of every kind, shipped agents; planted errors are found."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from rans_any_craft.frugality import numbers_of

from rans.base.errors import ConfigError
from rans.base.pretrained import pretrained_folder
from rans.deploy.contract import contract, golden
from rans.deploy.export import write_agent
from rans.evaluation.fly.agent import Agent
from rans.evaluation.fly.contestants import contestant
from rans.fast.agent_files.agent import SavedPolicy
from rans.fast.learn.config import FilterSettings, MemorySettings
from rans.fast.learn.run_folder import RunFolder
from rans.model.fields import atan2
from rans.model.spacecraft_file import load_spacecraft
from rans.policy.network import Network
from tests.support.exports import (
    asked,
    exported,
    own_answers,
    remembering,
    shipped,
    unequal,
    written,
)
from tests.support.shipped import ONE_OF_EACH_KIND
from tests.support.training import scatter, tiny_learner
from validation.speed.exported import ANSWERS, numpy_answer

FORMS = ("onnx", "numpy", "c")


@pytest.fixture(autouse=True)
def _whole_flights(monkeypatch) -> None:
    """Some planted errors are seen late in a flight alone."""
    monkeypatch.setattr("rans.deploy.contract.STEPS", 125)


def check_forms(
    network: Network,
    batches: list[np.ndarray],
    folder: Path,
    forms: Sequence[str] = FORMS,
    furthest: float = 1e-4,
) -> None:
    """An agent's exports answer as it does, and remember the same but for ten roundings in float32.

    These are 1e-5 of numbers of the order of one, and 1e-4 of logarithms of odds, up to 20, beside which a choice
    may be close.
    """
    written(folder, network, *forms)
    own = own_answers(network, batches)
    for form in forms:
        found = unequal(own, ANSWERS[form](folder))
        assert found.beyond == 0
        assert found.memory < furthest
        assert found.commands == 0 or furthest > 1e-5


COMPILED = {
    "any-craft-2d",
    "dock-port-2d-atmos",
    "go-to-pose-2d-robust",
    "land-3d",
}
"""Agents of every kind of head and preprocessing: a compiler takes seconds for an agent, and the tests of kinds of
networks give it the rest."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in ONE_OF_EACH_KIND else [pytest.mark.slow])
        for name in sorted(ONE_OF_EACH_KIND | COMPILED)
    ],
)
def test_a_shipped_agent_commands_the_same_in_every_form(name: str, tmp_path: Path) -> None:
    """A flight of 12 steps is longer than the memory of any agent."""
    network, setup = shipped(name)
    short = replace(setup.timing, episode_steps=12)
    batches = list(asked(network, setup._replace(timing=short), 100))
    forms = [form for form in FORMS if form != "c" or name in COMPILED]
    check_forms(network, batches, tmp_path, forms, 1e-5)


@pytest.mark.parametrize(
    "name",
    [
        "any-craft-2d#1",
        pytest.param("adaptive:any-craft-2d#1", marks=pytest.mark.slow),
    ],
)
def test_a_price_that_falls_near_the_goal_is_that_of_every_form(name: str, tmp_path: Path) -> None:
    """Observations of whole flights, which arrive."""
    run = contestant(name)
    own = run.network
    frugality = numbers_of(own.architecture)._replace(away=3.0)
    network = Network(replace(own.architecture, frugal=tuple(frugality)), own.tensors)
    batches = list(asked(network, run.judged, 8))
    check_forms(network, batches, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("craft", ["floating-platform-shared", "pingu", "spheres"])
def test_an_agent_that_adapts_commands_the_same_in_every_form(craft: str, tmp_path: Path) -> None:
    """With shared thrust, with a wheel, and of a craft that can spare no thruster."""
    dimension = load_spacecraft(craft).dimension
    run = contestant(f"adaptive:any-craft-{dimension}d@{craft}")
    assert isinstance(run.controller, Agent)
    network = run.network
    setup = run.judged._replace(timing=replace(run.timing, episode_steps=12))
    batches = list(asked(network, setup, 96))
    check_forms(network, batches, tmp_path)


def random_batches(network: Network, steps: int = 6, count: int = 50) -> list[np.ndarray]:
    random = np.random.default_rng(5)
    width = network.architecture.layout.width
    return list(random.normal(size=(steps, count, width)).astype(np.float32))


KINDS: list[dict[str, Any]] = [
    {"activation": "elu"},
    {"activation": "relu", "zoom": 8.0, "symmetric": True},
    {"continuous": True, "symmetric": True, "memory": MemorySettings(1)},
    {"memory": MemorySettings(3, (0.5, 0.9)), "symmetric": True, "zoom": 4.0},
    {"filters": FilterSettings((0.01, 1.0)), "symmetric": True, "zoom": 4.0},
    {
        "filters": FilterSettings((0.01, 1.0), response=(0.1, 0.0)),
        "symmetric": True,
    },
    {
        "memory": MemorySettings(0, (0.5,)),
        "symmetric": True,
        "filters": FilterSettings((0.1,)),
    },
]


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(KINDS)), ids=lambda k: str(KINDS[k]))
def test_every_kind_of_network(number: int, tmp_path: Path) -> None:
    """By turns of a craft in the plane and in space."""
    craft = load_spacecraft(("floating-platform", "free-flyer")[number % 2])
    network = scatter(tiny_learner(craft, **KINDS[number]).network)
    batches = random_batches(network)
    network.update_statistics(network.in_body(torch.from_numpy(batches[0]))[None])
    check_forms(network, batches, tmp_path, FORMS, 1e-5)


def changed(**tensors: Callable[[torch.Tensor], torch.Tensor]) -> Callable[[Network], Network]:
    """A copy of a network with other weights; a dot in a name is two underscores."""

    def plant(network: Network) -> Network:
        names = {name.replace("__", "."): change for name, change in tensors.items()}
        return Network(
            network.architecture,
            network.tensors
            | {name: change(network.tensors[name].clone()) for name, change in names.items()},
        )

    return plant


def swapped(first: int, second: int, size: int = 1) -> Callable[[Any], Any]:
    """Rows in another order."""

    def change(rows: Any) -> Any:
        order = np.arange(len(rows))
        a, b = (order[k * size : (k + 1) * size].copy() for k in (first, second))
        order[first * size : (first + 1) * size] = b
        order[second * size : (second + 1) * size] = a
        return rows[order]

    return change


def of_another(**fields: Any) -> Callable[[Network], Network]:
    return lambda network: Network(replace(network.architecture, **fields), network.tensors)


def other_place(network: Network) -> Network:
    """Two thrusters swapped in one view of the spacecraft."""
    views = network.architecture.symmetries
    assert views is not None
    place = views.place.copy()
    place[1, [0, 1]] = place[1, [1, 0]]
    return of_another(symmetries=views._replace(place=place))(network)


def other_hand(network: Network) -> Network:
    """Mirror images that turn the wrong way."""
    views = network.architecture.symmetries
    assert views is not None
    return of_another(symmetries=views._replace(hand=np.abs(views.hand)))(network)


ERRORS: dict[str, Callable[[Network], Network]] = {
    "a swapped thruster": changed(
        action_net__weight=swapped(0, 1, 2), action_net__bias=swapped(0, 1, 2)
    ),
    "a mean 2 cm off": changed(features_extractor__mean=lambda x: x + 0.02),
    "thrusters swapped in a view": other_place,
    "a mirror image that turns the wrong way": other_hand,
    "averages that forget sooner": of_another(averages=(0.5, 0.8, 0.9, 0.94)),
}


@cache
def right() -> tuple[str, Any]:
    """Golden pairs of the agent without an error, as JSON, and its answers."""
    network, _, seen = remembering()
    return json.dumps(golden(network, seen)), own_answers(network, list(seen))


@pytest.mark.parametrize(
    "error",
    [pytest.param(one, marks=[pytest.mark.slow] * (k % 2)) for k, one in enumerate(ERRORS)],
)
def test_planted_errors_are_found(error: str, tmp_path: Path) -> None:
    """By the comparison, and by the golden pairs that a robot engineer has."""
    network, _, _ = remembering()
    pairs, answers = right()
    written(tmp_path, ERRORS[error](network), "numpy")
    found = unequal(answers, numpy_answer(tmp_path))
    assert found.beyond > 0 or found.memory > 1e-3
    (tmp_path / "golden.json").write_text(pairs)
    same, count = checked(tmp_path)
    assert same < count == 500


def checked(folder: Path) -> tuple[int, int]:
    """What the exported file finds of its golden pairs."""
    return exported(folder)["check"]()


def test_golden_pairs_come_out_of_the_exported_file(tmp_path: Path) -> None:
    network, _, seen = remembering()
    pairs = golden(network, seen)
    assert [at for at, begins in enumerate(pairs["begins"]) if begins] == [0, 125, 250, 375]
    assert 0.02 < np.mean(pairs["command"]) < 0.5  # of both kinds
    written(tmp_path, network, "numpy")
    (tmp_path / "golden.json").write_text(json.dumps(pairs))
    assert checked(tmp_path) == (500, 500)


def test_a_contract_says_what_the_files_say() -> None:
    """Against the spacecraft's file as TOML, and the columns' documentation."""
    run = RunFolder(pretrained_folder("go-to-pose-2d"))
    text = run.spacecraft_file.read_text("utf-8")
    seen = np.stack([np.full((3, 10), -1.5), np.full((3, 10), 2.25)]).astype(np.float32)
    found = contract("me", run.config(), run.spacecraft(), text, 7, seen)
    table = tomllib.loads(text)
    assert found["spacecraft"]["sha256"] == sha256(text.encode()).hexdigest()
    assert [x["force"] for x in found["command"]["thrusters"]] == [
        x["force"] for x in table["thruster"]
    ]
    for told, meant in zip(found["command"]["thrusters"], table["thruster"], strict=True):
        assert told["position"][:2] == pytest.approx(meant["position"][:2])  # mass is in the origin
        long = np.hypot(*meant["direction"][:2])
        assert told["direction"][:2] == pytest.approx(np.divide(meant["direction"][:2], long))
    columns = (
        Path(__file__)
        .parents[2]
        .joinpath("docs/tasks.md")
        .read_text("utf-8")
        .partition("\n| 0 | ")[2]
    )
    lines = f"0 | {columns}".splitlines()[:10]
    rows = [[cell.strip() for cell in line.strip("| ").split("|")] for line in lines]
    assert [
        [str(x["column"]), x["name"], x["unit"], x["frame"]] for x in found["observation"]
    ] == rows
    # Of what was seen from -1.5 to 2.25 a tenth more on either side; a flag as it was, directions all around.
    ranges = [tuple(x["valid"]) for x in found["observation"]]
    assert {ranges[k] for k in (2, 3, 4, 6, 7)} == {(-1.875, 2.625)}
    assert ranges[5] == (-1.5, 2.25)
    assert {ranges[k] for k in (0, 1, 8, 9)} == {(-1.0, 1.0)}
    assert found["observation"][0]["bound"] == 1.0
    assert found["observation"][2]["bound"] is None
    assert (found["control_period"], found["memory"], found["agent"]) == (0.2, 7, "me")


def test_places_are_about_the_centre_of_mass() -> None:
    craft = load_spacecraft("floating-platform")
    moved = replace(craft, centre_of_mass=(0.01, -0.02, 0.0))
    run = RunFolder(pretrained_folder("go-to-pose-2d"))
    seen = np.zeros((1, 1, 10), np.float32)
    there, here = (
        contract("me", run.config(), one, "", 0, seen)["command"] for one in (moved, craft)
    )
    for a, b in zip(there["thrusters"], here["thrusters"], strict=True):
        assert np.subtract(b["position"], a["position"]) == pytest.approx([0.01, -0.02, 0.0])


def test_the_file_says_what_it_is(tmp_path: Path) -> None:
    """For runtimes and viewers: names, types, free rows, and the contract."""
    onnx = pytest.importorskip("onnx")
    network, _ = shipped("go-to-pose-2d-robust")
    write_agent(tmp_path, "onnx", SavedPolicy(network, 0), "it", '{"format": 1}')
    model = onnx.load(tmp_path / "agent.onnx")
    assert {x.key: x.value for x in model.metadata_props} == {
        "what": "it",
        "contract": '{"format": 1}',
    }
    shown = [
        (x.name, [d.dim_param or d.dim_value for d in x.type.tensor_type.shape.dim])
        for x in (*model.graph.input, *model.graph.output)
    ]
    memory = network.architecture.memory
    assert shown == [
        ("observation", ["N", 10]),
        ("memory", ["N", memory]),
        ("command", ["N", 8]),
        ("memory_out", ["N", memory]),
    ]


def test_a_layout_that_no_export_knows(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A plugin's entry may do more with its columns than turn them."""
    network, _ = shipped("go-to-pose-2d")
    kinds = network.architecture.layout.blocks[2].kind
    monkeypatch.setattr(
        kinds, "mirrored", staticmethod(lambda columns, view, hand: [atan2(columns[0], hand)])
    )
    with pytest.raises(ConfigError, match="only be exported as rans: 'atan2'"):
        written(tmp_path, network, "onnx")
