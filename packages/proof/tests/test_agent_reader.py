"""The checkers' own reader of agents: against the reader that flies, and against files that say two things."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("flint")

from rans_proof.agent_reader import read_agent
from rans_proof.balls import Refused

from rans.fast.agent_files.agent import policy_of

Edit = Callable[[dict[str, Any], dict[str, Any], bytearray], object]


@pytest.fixture
def content(files: dict[str, bytes]) -> bytes:
    return files["agent.safetensors"]


def test_it_reads_what_flies(content: bytes, folder: Path) -> None:
    """Every number, by the library of safetensors behind the other reader."""
    network = policy_of(content, folder).network
    weights = read_agent(content, 8)
    named = {
        "features_extractor.mean": weights.mean,
        "features_extractor.variance": weights.variance,
        "action_net.weight": weights.head[0],
        "action_net.bias": weights.head[1],
    }
    for number, (weight, bias) in enumerate(weights.layers):
        named[f"features_extractor.trunk.{2 * number}.weight"] = weight
        named[f"features_extractor.trunk.{2 * number}.bias"] = bias
    assert len(named) == 8
    for name, value in named.items():
        assert np.array_equal(network.tensors[name].double().numpy(), value), name


def edited(content: bytes, edit: Edit) -> bytes:
    """The file with a change of its header, its table or its bytes, and lengths that are right again."""
    length = int.from_bytes(content[:8], "little")
    header = json.loads(content[8 : 8 + length])
    table = json.loads(header["__metadata__"]["rans"])
    data = bytearray(content[8 + length :])
    edit(header, table, data)
    header["__metadata__"]["rans"] = json.dumps(table)
    header["__metadata__"]["crc32"] = str(zlib.crc32(b"whatever"))
    text = json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text + bytes(data)


def network(**changes: Any) -> Edit:
    return lambda header, table, data: table["architecture"].update(changes)


WEIGHT = "features_extractor.trunk.2.weight"


def swapped(header: dict[str, Any], table: dict[str, Any], data: bytearray) -> None:
    """Two weights of one size that refer to each other's tensors."""
    first = "features_extractor.mean"
    second = "features_extractor.variance"
    weights = table["weights"]
    weights[first], weights[second] = weights[second], weights[first]


def moved(header: dict[str, Any], table: dict[str, Any], data: bytearray) -> None:
    """A tensor that lies on another one's bytes."""
    entry = header[f"weights/{WEIGHT}"]
    entry["data_offsets"] = [x - 16 for x in entry["data_offsets"]]


def infinite(header: dict[str, Any], table: dict[str, Any], data: bytearray) -> None:
    begin = header[f"weights/{WEIGHT}"]["data_offsets"][0]
    data[begin : begin + 4] = np.float32(np.inf).tobytes()


EDITS: dict[str, Edit] = {
    "zoom": network(zoom=16.0),
    "history": network(history=4),
    "symmetries": network(symmetries={"turn": []}),
    "a field of tomorrow": network(wings=2),
    "a flag for a number": network(history=False),
    "another head": network(head="gaussian"),
    "another clip": network(clip=5.0),
    "thrusters": network(thrusters=7),
    "fewer layers": network(layers=[14]),
    "another observation": network(layout=[["rans.tasks.sight.Scalar", 8, []]]),
    "another task": lambda h, t, d: t["architecture"]["layout"].pop(),
    "swapped references": swapped,
    "overlapping tensors": moved,
    "infinite": infinite,
    "bytes at the end": lambda header, table, data: data.extend(b"four"),
    "a transposed matrix": lambda h, t, d: h["weights/action_net.weight"].update(shape=[6, 16]),
    "an unused tensor": lambda h, t, d: t["weights"].update(core={"$tensor": "weights/core"}),
}
WHOLE: dict[str, Callable[[bytes], bytes]] = {
    "a key twice": lambda x: x.replace(b'\\"zoom\\": 0.0', b'\\"bf16\\": 0.0', 1),
    "a long header": lambda x: (2**40).to_bytes(8, "little") + x[8:],
    "nothing": lambda x: b"",
}


@pytest.mark.parametrize("planted", [*EDITS, *WHOLE])
def test_another_network_is_refused(planted: str, content: bytes) -> None:
    other = edited(content, EDITS[planted]) if planted in EDITS else WHOLE[planted](content)
    assert other != content
    with pytest.raises(Refused):
        read_agent(other, 8)


def test_an_unchanged_file_of_the_editor_is_read(content: bytes) -> None:
    """What is refused above is not refused for the editing."""
    again = read_agent(edited(content, lambda header, table, data: None), 8)
    assert np.array_equal(again.variance, read_agent(content, 8).variance)
