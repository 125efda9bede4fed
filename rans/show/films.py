"""Films of flights, which packages make."""

from __future__ import annotations

from collections.abc import Callable

from rans.base.registry import Registry

FILMS: Registry[Callable[..., None]] = Registry("kind of film", "rans.films")
"""What writes flights side by side as a film, by the ending of its name: of flights, file and progress
(`rans.base.progress.Stages`). With ``check`` it only refuses (`ConfigError`) what could not be written."""
