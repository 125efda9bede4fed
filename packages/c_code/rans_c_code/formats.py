"""The formats ``c`` and ``c8`` of `rans export` (entry points of the group ``rans.export_formats``)."""

from __future__ import annotations

import torch

from rans.extend import EXTRACTOR, Format, Network
from rans_c_code.compiler import compiled_check
from rans_c_code.compressed import in_steps
from rans_c_code.files import write_c


def rounded(network: Network) -> Network:
    """A network whose layers have weights in whole steps of the largest of their row."""
    tensors = {
        name: torch.from_numpy(in_steps(x.numpy()))
        if name.startswith(EXTRACTOR) and x.ndim == 2
        else x
        for name, x in network.weights().items()
    }
    # Of an on/off thruster the difference of both outputs is what is exported.
    last = tensors["action_net.weight"]
    folded, _ = network.architecture.last.folded(last, tensors["action_net.bias"])
    rounded = torch.from_numpy(in_steps(folded.numpy()))
    if len(folded) < len(last):
        rounded = torch.stack([torch.zeros_like(rounded), rounded], dim=1).flatten(0, 1)
    tensors["action_net.weight"] = rounded
    return Network(network.architecture, tensors)


_FILES = ("agent.h", "agent.c", "agent_check.c")
C = Format(write_c, _FILES, is_prefixed=True, check=compiled_check)
"""A header and a source of C99, and a program that checks them."""
C8 = C._replace(reduced=rounded)
"""The export format c8: agents as C99 whose weights are rounded to a byte each."""
