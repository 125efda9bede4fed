"""What is read of agents' files: arrays and known settings, and nothing else."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from rans import ConfigError
from rans.base.pretrained import pretrained_folder
from rans.fast.agent_files import tensors as tensor_file
from rans.fast.agent_files.agent import AGENT, SavedPolicy, actor_bytes, read_policy
from rans.fast.agent_files.tensors import pack_tensors, unpack_tensors
from rans.fast.learn.run_folder import RunFolder
from rans.policy.network import Network


def opened(folder: Path) -> SavedPolicy:
    return read_policy(RunFolder(folder).agent_file)


@pytest.fixture
def alone(tmp_path) -> Path:
    """A shipped agent that a test may spoil."""
    return Path(shutil.copytree(pretrained_folder("go-to-pose-2d"), tmp_path / "alone"))


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


def test_a_header_is_not_read_that_is_larger_than_any(monkeypatch):
    content = pack_tensors({"steps": 1, "more": "x" * 2000})
    assert unpack_tensors(content, "here")["steps"] == 1
    monkeypatch.setattr(tensor_file, "_LARGEST_HEADER", 2000)
    with pytest.raises(
        ConfigError, match=r"here .*: its header has [\d,]+ bytes, and at most 2,000"
    ):
        unpack_tensors(content, "here")


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300])
def test_weights_that_are_not_finite_are_told_by_name(alone, value):
    """At once, or in single precision."""

    def spoil(table):
        weights = table["weights"]["action_net.bias"].double()
        weights[0] = value
        table["weights"]["action_net.bias"] = weights

    assert "the agent's tensor action_net.bias has numbers that are not finite" in spoilt(
        alone, spoil
    )


def spoilt(folder: Path, change: Callable[[dict[str, Any]], object]) -> str:
    """What is said of an agent whose table somebody changed."""

    table = unpack_tensors((folder / AGENT).read_bytes(), AGENT)
    change(table)
    (folder / AGENT).write_bytes(pack_tensors(table))
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
    ("change", "sentence"),
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
    ],
)
def test_a_table_that_somebody_changed(alone, change, sentence):
    text = spoilt(alone, change)
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
def test_a_critic_that_somebody_changed(trained, tmp_path, change, sentence):
    """One that is left out may not claim layers of its own, which would be made of zeros."""
    run = Path(shutil.copytree(trained, tmp_path / "run"))
    assert sentence in spoilt(run, change)


def test_the_header_is_readable_without_us(alone):
    """Length, JSON, arrays: as the format of safetensors has it, with any library for it."""
    content = (alone / AGENT).read_bytes()
    header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
    table = json.loads(header["__metadata__"]["rans"])
    assert table["architecture"]["layers"] == [256, 256]
    assert header["weights/action_net.bias"]["shape"] == [16]
