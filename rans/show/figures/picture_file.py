"""Files of figures: .png, .svg and .pdf."""

from __future__ import annotations

from pathlib import Path

from rans.base.errors import ConfigError
from rans.base.files import replace_file
from rans.show.figures.plotting import Figure


def check_picture(file: Path) -> None:
    """Reject (`ConfigError`) file names that `save_picture` does not support."""
    if file.suffix not in (".png", ".svg", ".pdf"):
        raise ConfigError(f"a picture's name must end in .png, .svg or .pdf, got {str(file)!r}.")


def save_picture(figure: Figure, file: Path) -> None:
    """Save a figure as .png, .svg or .pdf.

    Raises:
        ConfigError: the name has another ending, or the file cannot be written.
    """
    check_picture(file)
    replace_file(file, lambda draft: figure.savefig(draft, dpi=150))
