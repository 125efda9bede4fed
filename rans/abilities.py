"""Public names that installed packages add to `rans`."""

from __future__ import annotations

from typing import Any

from rans.registry import Registry

PUBLIC: Registry[Any] = Registry(
    kind="public name", group="rans.public", built_in={}, checked=lambda value: value
)
"""Public names that installed packages add (entry points ``rans.public``)."""
