"""Commands and public names that an installed package adds, and those whose package is absent."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import rans
from tests.support.processes import ROOT, printed


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A folder with an installed package that adds the command `hover` and the name `rans.hover`."""
    (tmp_path / "hovering.py").write_text(
        '''from dataclasses import dataclass

@dataclass(frozen=True)
class Hover:
    """Hover for a while.

    """

    group = "Judge"
    guide = "docs/hover.md"
    examples = ("rans hover --seconds 3",)

    seconds: int = 1
    """Time, s."""

    def run(self) -> int:
        print(f"hovered for {self.seconds} s")
        return 0

    def following(self):
        return ("rans list",)

def hover() -> str:
    return "hovered"
''',
        "utf-8",
    )
    info = tmp_path / "hovering-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: hovering\nVersion: 1.0\n", "utf-8")
    (info / "entry_points.txt").write_text(
        "[rans.commands]\nhover = hovering:Hover\n[rans.public]\nhover = hovering:hover\n", "utf-8"
    )
    return tmp_path


def ran(site: Path, *arguments: str) -> str:
    """What an interpreter prints that finds the package."""
    return printed(*arguments, PYTHONPATH=os.pathsep.join((str(site), str(ROOT))))


def test_a_package_adds_a_command_and_a_public_name(site: Path) -> None:
    assert (
        ran(site, "-m", "rans", "hover", "--seconds", "3")
        == "hovered for 3 s\nNext:\n  rans list\n"
    )
    text = ran(site, "-m", "rans", "hover", "--help")
    assert "rans hover --seconds 3" in text
    assert "docs/hover.md" in text
    code = "import rans; assert 'hover' in dir(rans); print(rans.hover())"
    assert ran(site, "-c", code) == "hovered\n"


def test_a_name_that_nothing_has_is_an_attribute_error() -> None:
    assert not hasattr(rans, "levitate")
