"""Backbones by name: those of RANS, and those that installed packages offer (entry points ``rans.backbones``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rans.errors import ConfigError, brief
from rans.registry import Registry

if TYPE_CHECKING:
    from rans.policy.backbones import Backbone


def _checked(loaded: Any) -> Backbone:
    """An object of the class, checked to be a backbone (`ConfigError`)."""
    from rans.policy.backbones import Backbone  # needs torch, which names do not

    if not (isinstance(loaded, type) and issubclass(loaded, Backbone)):
        raise ConfigError(
            f"a backbone must be a class derived from rans.policy.backbones.Backbone, got {brief(loaded)}."
        )
    return loaded()


BACKBONES: Registry[Backbone] = Registry(
    "backbone",
    "rans.backbones",
    {
        "dense": "rans.policy.backbones:Dense",
        "allocated": "rans.policy.allocated:Allocated",
    },
    _checked,
)
"""Backbones by their names in settings and agents' files."""
