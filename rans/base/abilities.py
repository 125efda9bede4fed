"""Public names that installed packages add to `rans`."""

from __future__ import annotations

from typing import Any

from rans.base.registry import Registry

PUBLIC: Registry[Any] = Registry("public name", "rans.public")
"""Public names that installed packages add (entry points ``rans.public``)."""
