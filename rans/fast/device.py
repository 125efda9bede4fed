"""Torch device of a command or a training."""

from __future__ import annotations


def torch_device(device: str = "auto") -> str:
    """Torch device for "auto", "cpu" or "cuda"; "auto" is a GPU if there is one."""
    if device != "auto":
        return device
    import torch  # late: names are checked without it

    return "cuda" if torch.cuda.is_available() else "cpu"
