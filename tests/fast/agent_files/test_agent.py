"""What is read of agents' files: arrays and known settings, whatever else is in a ``policy.zip``."""

from __future__ import annotations

import io
import json
import math
import os
import shutil
import tracemalloc
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_baselines3
import torch
from stable_baselines3.common.save_util import load_from_zip_file

from rans import ConfigError, archives
from rans.deploy.export import write_agent
from rans.fast.agent_files import tensors as tensor_file
from rans.fast.agent_files.agent import AGENT, SavedPolicy, actor_bytes, read_policy
from rans.fast.agent_files.tensors import pack_tensors, unpack_tensors
from rans.fast.learn.run_folder import RunFolder
from rans.fast.policy import network_of
from rans.policy.network import Network
from rans.pretrained import pretrained_folder
from tests.support.shipped import shipped_agents
from tests.support.strangers import older, rewritten, trapped, trapped_weights


def opened(folder: Path) -> SavedPolicy:
    return read_policy(RunFolder(folder).agent_file)


@pytest.fixture
def alone(tmp_path) -> Path:
    """A shipped agent that a test may spoil."""
    return Path(shutil.copytree(pretrained_folder("go-to-pose-2d"), tmp_path / "alone"))


@pytest.fixture
def folder(tmp_path) -> Path:
    """The same as ``policy.zip``, as trainings and `rans export` write it."""
    return zipped("go-to-pose-2d", tmp_path / "agent")


def zipped(name: str, folder: Path) -> Path:
    """A folder with a shipped agent's ``policy.zip``."""
    run = RunFolder(pretrained_folder(name))
    folder.mkdir()
    write_agent(folder, "sb3", read_policy(run.agent_file), run.config().ppo, name)
    return folder


@pytest.mark.parametrize("name", shipped_agents())
def test_it_is_the_agent_that_sb3_unpickles(name, tmp_path):
    """Every bit of it."""
    folder = zipped(name, tmp_path / "agent")
    data, parameters, _ = load_from_zip_file(folder / "policy.zip", device="cpu")
    assert data is not None
    policy = data["policy_class"](
        data["observation_space"], data["action_space"], lambda _: 1e-3, **data["policy_kwargs"]
    )
    policy.load_state_dict(parameters["policy"])
    expected = network_of(policy)
    found = opened(folder).network
    assert found.tensors.keys() == expected.tensors.keys()
    for key, tensor in expected.tensors.items():
        assert torch.equal(found.tensors[key], tensor), key
    ours = found.architecture
    theirs = expected.architecture
    for key in (
        "layout",
        "thrusters",
        "layers",
        "activation",
        "zoom",
        "continuous",
        "history",
        "averages",
        "clip",
        "filters",
    ):
        assert getattr(ours, key) == getattr(theirs, key), key
    assert (ours.symmetries is None) == (theirs.symmetries is None)
    for one, other in zip(ours.symmetries or (), theirs.symmetries or (), strict=True):
        np.testing.assert_array_equal(one, other)


def test_code_in_its_pickles_is_not_run(folder, tmp_path):
    file = folder / "policy.zip"
    ran = tmp_path / "ran"
    before = opened(folder).network.tensors
    for trap in (trapped_weights, trapped):
        trap(file, ran)
        now = opened(folder).network.tensors
        assert all(torch.equal(x, before[name]) for name, x in now.items())
    assert not ran.exists()
    with pytest.raises(Exception):  # noqa: B017, PT011  # the trap works where somebody unpickles
        stable_baselines3.PPO.load(file)
    assert ran.exists()


def test_pickles_alone_are_refused_with_what_to_do(folder):
    """As early versions of RANS wrote them, and as Stable-Baselines3 does."""
    older(folder / "policy.zip")
    with pytest.raises(ConfigError, match=r"holds no agent\.safetensors.* [Tt]rain the agent anew"):
        opened(folder)


@pytest.mark.parametrize("name", ["go-to-pose-2d", "go-to-pose-3d-faults", "go-to-pose-3d-robust"])
def test_what_flies_is_kept_of_an_agent_and_no_more(name, tmp_path):
    """Commands of an agent without its critic, which may have had layers of its own, are the agent's."""
    shipped = read_policy(RunFolder(pretrained_folder(name)).agent_file).network
    given = replace(shipped.architecture, privileged=3, nominal=(1.0, 2.0, 3.0))
    tensors = given.initial(1, 0.5)[0] | {
        key: x for key, x in shipped.tensors.items() if not key.startswith("value_net.")
    }
    whole = Network(given, tensors)
    file = tmp_path / AGENT
    file.write_bytes(actor_bytes(given, whole.weights(), 128))
    saved = read_policy(file)
    assert saved.steps == 128
    assert file.stat().st_size < 4 * sum(x.numel() for x in tensors.values())
    rows = torch.randn(50, given.layout.width, generator=torch.Generator().manual_seed(1))
    memory = whole.initial_state(50)
    with torch.no_grad():
        commands = [one.evaluate(rows, memory).policy.mode() for one in (whole, saved.network)]
    assert torch.equal(*commands)
    assert 0.02 < commands[0].mean() < 0.98


MUCH = bytes(11 * 2**20)
"""More than archives may unpack to in these tests, so that making it takes no time."""


def deflated(content: bytes) -> bytes:
    """An archive of one member, a thousandth of its size."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data", content)
    return stream.getvalue()


def add(file: Path, name: str, content: bytes, method: int = zipfile.ZIP_DEFLATED) -> None:
    with zipfile.ZipFile(file, "a", method) as archive:
        archive.writestr(name, content)


def test_a_bomb_is_not_unpacked(folder, monkeypatch):
    """Much in little, of which no member is too large alone."""
    monkeypatch.setattr(archives, "_LARGEST", 10 * 2**20)
    for name in ("one", "two"):
        add(folder / "policy.zip", name, MUCH[: 6 * 2**20])
    sentence = (
        r"policy\.zip.* was not opened: its .* would unpack to [\d,]+ bytes, and at most [\d,]+ are"
    )
    with pytest.raises(ConfigError, match=sentence):
        opened(folder)


def test_what_is_as_large_on_the_disk_is_opened(folder, monkeypatch):
    """Such an agent is large, but no bomb."""
    monkeypatch.setattr(archives, "_LARGEST", 2**20)
    add(folder / "policy.zip", "more", os.urandom(2**21), zipfile.ZIP_STORED)
    opened(folder)


def test_a_member_that_is_more_than_it_says(folder):
    """Its place in the list of members has another size; no more than a chunk of it is unpacked at once."""
    file = folder / "policy.zip"
    true = len(MUCH).to_bytes(4, "little")
    claimed = (9).to_bytes(4, "little")
    file.write_bytes(deflated(MUCH).replace(true, claimed))
    tracemalloc.start()
    with pytest.raises(ConfigError, match=r"policy\.zip is damaged"):
        read_policy(file)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < len(MUCH) // 2


def test_members_are_packed_as_agents_are(folder):
    """How much other methods unpack at once has no bound."""
    add(folder / "policy.zip", "more", b"", zipfile.ZIP_LZMA)
    with pytest.raises(ConfigError, match="another method than deflation"):
        opened(folder)


def test_a_header_is_not_read_that_is_larger_than_any(monkeypatch):
    content = pack_tensors({"steps": 1, "more": "x" * 2000})
    assert unpack_tensors(content, "here")["steps"] == 1
    monkeypatch.setattr(tensor_file, "_LARGEST_HEADER", 2000)
    with pytest.raises(
        ConfigError, match=r"here .*: its header has [\d,]+ bytes, and at most 2,000"
    ):
        unpack_tensors(content, "here")


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300])
def test_weights_that_are_not_finite_are_told_by_name(folder, value):
    """At once, or in single precision."""

    def spoil(table):
        weights = table["weights"]["action_net.bias"].double()
        weights[0] = value
        table["weights"]["action_net.bias"] = weights

    assert "the agent's tensor action_net.bias has numbers that are not finite" in spoilt(
        folder, spoil
    )


def spoilt(folder: Path, change: Callable[[dict[str, Any]], object]) -> str:
    """What is said of an agent whose table somebody changed."""

    def changed(name: str, content: bytes) -> bytes:
        if name != AGENT:
            return content
        table = unpack_tensors(content, name)
        change(table)
        return pack_tensors(table)

    if (folder / AGENT).exists():
        (folder / AGENT).write_bytes(changed(AGENT, (folder / AGENT).read_bytes()))
    else:
        rewritten(folder / "policy.zip", changed)
    with pytest.raises(ConfigError) as caught:
        opened(folder)
    return str(caught.value)


_FILTERS = {
    "drift": [1.0],
    "period": 0.2,
    "push": [[0.1, 0.0]] * 3,
    "twist": [[0.1]] * 3,
    "share": [[0.0, 0.0, 0.0]] * 5,
    "gate": 5.0,
}
"""Of a craft with three thrusters."""


def architecture(**changes: Any) -> Callable[[dict[str, Any]], object]:
    return lambda table: table["architecture"].update(changes)


def own_filters(**changes: Any) -> Callable[[dict[str, Any]], object]:
    """Filters of the agent's own craft, but for the changes."""
    own = {"push": [[0.1, 0.0]] * 8, "twist": [[0.1]] * 8}
    return architecture(filters=_FILTERS | own | changes)


@pytest.mark.parametrize(
    ("number", "change", "sentence"),
    [
        (number, *one)
        for number, one in enumerate(
            [
                (architecture(layers=[10**6, 10**6]), "not those of the network"),
                (architecture(layers=[1] * 10**5), "not those of the network"),
                (architecture(layers=[-1]), "is damaged"),
                (architecture(activation="exec"), "is damaged"),
                (architecture(thrusters=2**70), "is damaged"),
                (architecture(surprise=1), "is damaged"),
                (
                    lambda t: t["architecture"]["symmetries"]["place"].fill_(99),
                    "symmetries are of another spacecraft",
                ),
                (architecture(zoom=math.nan), "in its zoom there are numbers that are not finite"),
                (own_filters(drift=[math.nan]), "in its filters there are numbers"),
                (architecture(filters=_FILTERS), "its filters are of another spacecraft"),
                (architecture(filters=_FILTERS | {"drift": "all"}), "is damaged"),
                (architecture(filters={"drift": [1.0]}), "is damaged"),
                *(
                    (own_filters(**wrong), "its filters are of another")
                    for wrong in (
                        {"period": [0.2]},
                        {"drift": [[1.0]]},
                        {"steady": 1.0, "response": 1.0},
                        {"steady": [1.0] * 2, "response": [1.0] * 2},
                        {"gate": [5.0]},
                        {"gate": 1e-200},
                    )
                ),
                (own_filters(), "not those of the network"),
                (own_filters(steady=[25.0]), "train it anew"),
                (own_filters(gate=0.0), "train it anew"),
                (
                    lambda t: t["architecture"]["layout"][0].__setitem__(0, "os.system"),
                    "unknown kind os.system",
                ),
                (lambda t: t.pop("steps"), "is damaged"),
                (lambda t: t.update(weights=[1, 2]), "is damaged"),
            ]
        )
    ],
)
def test_a_table_that_somebody_changed(request, number, change, sentence):
    """By turns in both forms of a file: what is refused in a table does not depend on them."""
    form = ("folder", "alone")[number % 2]
    text = spoilt(request.getfixturevalue(form), change)
    assert sentence in text
    assert len(text) < 600


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda t: t["weights"].pop("value_net.bias"), "not those of the network"),
        (
            lambda t: t["weights"].update({"value_net.bias": torch.zeros(3)}),
            "not those of the network",
        ),
        (
            lambda t: (
                [t["weights"].pop(f"value_net.{part}") for part in ("weight", "bias")]
                and t["architecture"].update(privileged=2**40)
            ),
            "not those of the network",
        ),
    ],
)
def test_a_critic_that_somebody_changed(folder, change, sentence):
    """One that is left out may not claim layers of its own, which would be made of zeros."""
    assert sentence in spoilt(folder, change)


def test_the_header_is_readable_without_us(alone):
    """Length, JSON, arrays: as the format of safetensors has it, with any library for it."""
    content = (alone / AGENT).read_bytes()
    header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
    table = json.loads(header["__metadata__"]["rans"])
    assert table["architecture"]["layers"] == [256, 256]
    assert header["weights/action_net.bias"]["shape"] == [16]
