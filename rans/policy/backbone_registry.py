"""Backbones by name, which installed packages add to; their classes need torch, which names do not."""

from __future__ import annotations

from functools import cache
from typing import Any

from rans.base.registry import Registry

BACKBONES: Registry[Any] = Registry(
    "backbone",
    "rans.backbones",
    {"dense": "rans.policy.backbones:DENSE"},
    checked="rans.policy.architecture:Backbone",
)
"""`rans.policy.architecture.Backbone` by their names in settings and agents' files."""


@cache
def backbone(name: str) -> Any:
    """The backbone of a name in `BACKBONES`."""
    return BACKBONES[name]
