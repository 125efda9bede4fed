"""Tensors of agents as bytes: whole, damaged and foreign."""

import json
import math

import pytest
import torch
from safetensors.torch import save

from rans import ConfigError
from rans.fast.agent_files.tensors import _checksum, pack_tensors, unpack_tensors


def test_what_is_packed_comes_back():
    generator = torch.get_rng_state()
    row = torch.arange(12.0)
    tree = {
        "views": [row[:6].view(2, 3), row[6:]],
        "state": generator,
        "number": 0.1 + 0.2,
        "big": 2**70,
        "none": None,
        "empty": torch.zeros(0, 3),
        "deep": {"a": {"b": [True, "text"]}},
        "double": torch.tensor(math.pi, dtype=torch.float64),
    }
    again = unpack_tensors(pack_tensors(tree), "there")
    for one, other in zip(tree["views"], again["views"], strict=True):
        assert torch.equal(one, other)
    assert torch.equal(again["state"], generator)
    assert again["double"].dtype == torch.float64
    assert float(again["double"]) == math.pi
    assert again["empty"].shape == (0, 3)
    plain = {key: again[key] for key in ("number", "big", "none", "deep")}
    assert plain == {key: tree[key] for key in plain}


def test_every_bit_counts(tmp_path):
    content = pack_tensors(
        {"steps": 128, "weights": torch.arange(5.0), "flags": torch.tensor([True, False])}
    )
    for place in range(8, len(content)):
        spoilt = bytearray(content)
        spoilt[place] ^= 1
        with pytest.raises(ConfigError, match=r"^there is damaged"):
            unpack_tensors(bytes(spoilt), "there")


@pytest.mark.parametrize(
    ("table", "names"),
    [
        ({"weights": {"a": {"$tensor": "evil/a"}}}, ("weights/a", "evil/a")),
        ({"weights": {"a": {"$tensor": "evil/a"}}}, ("evil/a",)),
        ({"weights": {"a": {"$tensor": "weights/a"}}}, ("weights/a", "weights/b")),
        ({"rows": [{"$tensor": "rows/1"}, {"$tensor": "rows/0"}]}, ("rows/0", "rows/1")),
    ],
)
def test_a_tensor_that_is_not_where_its_name_says_is_refused(table, names):
    """Who reads tensors by name and who reads the table would read different weights."""
    tensors = {name: torch.full((2,), float(k)) for k, name in enumerate(names)}
    text = json.dumps(table)
    content = save(tensors, {"rans": text, "crc32": _checksum(text, tensors)})
    with pytest.raises(ConfigError, match=r"^there is damaged.*(refers to|refer to)"):
        unpack_tensors(content, "there")
