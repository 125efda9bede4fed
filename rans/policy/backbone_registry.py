"""Backbones by name, which installed packages add to; their classes need torch, which names do not."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from rans.base.registry import Registry

if TYPE_CHECKING:
    from rans.policy.backbones import AnyCraft, Backbone

BACKBONES: Registry[Backbone] = Registry(
    "backbone",
    "rans.backbones",
    {"dense": "rans.policy.backbones:DENSE"},
    checked="rans.policy.backbones:Backbone",
)
"""Backbones by their names in settings and agents' files."""


@cache
def backbone(name: str) -> Backbone:
    """The backbone of a name in `BACKBONES`."""
    return BACKBONES[name]


@cache
def any_craft() -> AnyCraft:
    """What an installed backbone offers, whose networks fly any craft."""
    return next(found for _, one in BACKBONES.each() if (found := one.any_craft) is not None)
