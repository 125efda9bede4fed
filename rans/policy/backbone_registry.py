"""Backbones by name; their classes need torch, which names do not."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from rans.registry import resolve

if TYPE_CHECKING:
    from rans.policy.backbones import Backbone

BACKBONES = {
    "dense": "rans.policy.backbones:Dense",
    "allocated": "rans.policy.allocated:Allocated",
}
"""Classes of backbones by their names in settings and agents' files."""


@cache
def backbone(name: str) -> Backbone:
    """The backbone of a name in `BACKBONES`."""
    return resolve(BACKBONES[name])()
