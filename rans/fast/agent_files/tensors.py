"""Nested tables of numbers, texts and tensors as safetensors and JSON, which are read without running code."""

from __future__ import annotations

import json
import zlib
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from rans.base.errors import ConfigError, brief
from rans.base.files import first_line, parse_json

_TABLE = "rans"
"""Key of the metadata: table of everything but the tensors, as JSON."""
_CHECKSUM = "crc32"
"""Key of the metadata: checksum of the table and of all tensors, which safetensors does not have."""
_LARGEST_HEADER = 2**25
"""Largest number of bytes of a header; its Python objects take many times as much."""
_TENSOR = "$tensor"
"""Key in the table of a reference to a tensor by its name, which is the path of the reference."""


def pack_tensors(tree: Any) -> bytes:
    """Content of a safetensors file from dictionaries and lists of numbers, texts, None and tensors.

    Tensors are named by their path, as ``learner/weights/value_net.bias``; keys become texts and tuples lists.
    """
    tensors: dict[str, Tensor] = {}
    table = json.dumps(_split(tree, "", tensors))
    content = save(tensors, {_TABLE: table, _CHECKSUM: _checksum(table, tensors)})
    # The library writes the keys of metadata in another order in every call: equal agents shall be equal files.
    length = int.from_bytes(content[:8], "little")
    header = parse_json(content[8 : 8 + length], "this header")
    header["__metadata__"] = dict(sorted(header["__metadata__"].items()))
    text = json.dumps(header, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 8)  # numbers begin at multiples of 8 bytes
    return len(text).to_bytes(8, "little") + text + content[8 + length :]


def unpack_tensors(content: bytes, where: object, device: str | torch.device = "cpu") -> Any:
    """Table that `pack_tensors` stored, with its tensors on a device.

    Args:
        content: content of a safetensors file.
        where: name of the file in messages.
        device: device of the tensors.

    Raises:
        ConfigError: the content is not from `pack_tensors`, or is damaged.
    """
    length = int.from_bytes(content[:8], "little")  # length of the header
    if _LARGEST_HEADER < length < len(content):
        raise ConfigError(
            f"{where} was not opened: its header has {length:,} bytes, and at most {_LARGEST_HEADER:,} "
            "are read; it is damaged or malicious."
        )
    try:
        tensors = load(content)
        metadata = parse_json(content[8 : 8 + length], where)["__metadata__"]
        if metadata[_CHECKSUM] != _checksum(metadata[_TABLE], tensors):
            raise ValueError("its checksum is wrong")
        left = {name: x.to(device) for name, x in tensors.items()}
        table = _joined(parse_json(metadata[_TABLE], where), "", left)
        if left:
            raise ValueError(f"nothing in its table refers to its tensor {brief(min(left))}")
        return table
    except (SafetensorError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise ConfigError(
            f"{where} is damaged, it is not a safetensors file of RANS: {first_line(error)}."
        ) from error


def _checksum(table: str, tensors: dict[str, Tensor]) -> str:
    result = zlib.crc32(table.encode())
    for name, x in sorted(tensors.items()):
        result = zlib.crc32(f"{name} {x.dtype} {list(x.shape)}".encode(), result)
        result = zlib.crc32(x.flatten().view(torch.uint8).numpy().tobytes(), result)
    return str(result)


def _split(value: Any, path: str, tensors: dict[str, Tensor]) -> Any:
    """The value with names in place of tensors, which are added to ``tensors`` by their paths, on the CPU.

    The paths are names of tensors in every agent's file, by which others read them.
    """
    if isinstance(value, Tensor):
        tensors[path] = value.detach().cpu().contiguous().clone()
        return {_TENSOR: path}
    if isinstance(value, dict):
        return {key: _split(inner, _below(path, key), tensors) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_split(inner, _below(path, index), tensors) for index, inner in enumerate(value)]
    return value


def _joined(value: Any, path: str, left: dict[str, Tensor]) -> Any:
    """The value with tensors in place of their names, which are taken out of ``left``.

    A name that is not its own path is refused: a reader by names would read other tensors than one of the table.
    """
    if isinstance(value, dict):
        if value.keys() == {_TENSOR}:
            if value[_TENSOR] != path:
                raise ValueError(f"its {path} refers to the tensor {brief(value[_TENSOR])}")
            return left.pop(path)
        return {key: _joined(inner, _below(path, key), left) for key, inner in value.items()}
    if isinstance(value, list):
        return [_joined(inner, _below(path, index), left) for index, inner in enumerate(value)]
    return value


def _below(path: str, key: object) -> str:
    """Path of an entry of a dictionary or list."""
    return f"{path}/{key}" if path else str(key)
