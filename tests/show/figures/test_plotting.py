"""Figures are drawn whatever backend of matplotlib the environment names."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.processes import ROOT

PROGRAM = """
import os
import rans
from rans.show.figures.layout_figure import draw_layout
before = os.environ.get("MPLBACKEND")
draw_layout(rans.load_spacecraft("floating-platform")).savefig("layout.svg")
import matplotlib
assert os.environ.get("MPLBACKEND") == before
print(matplotlib.rcParams._get("backend") if isinstance(before, str) else None)
"""


def ran(folder: Path, program: str, **variables: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONPATH": str(ROOT)} | variables,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize(
    ("name", "then"),
    [
        ("module://no_such_package.backend", "module://no_such_package.backend"),
        ("module://matplotlib_inline.backend_inline", None),  # of a notebook's kernel
        ("svg", "svg"),  # a user's script keeps what it asks for
    ],
)
def test_a_backend_that_is_not_installed(name, then, tmp_path):
    printed = ran(tmp_path, PROGRAM, MPLBACKEND=name)
    assert (tmp_path / "layout.svg").read_text().rstrip().endswith("</svg>")
    if then is not None:
        assert printed == then


def test_a_backend_of_a_configuration_file(tmp_path):
    (tmp_path / "matplotlibrc").write_text("backend: no-such-backend\n")
    ran(tmp_path, PROGRAM, MATPLOTLIBRC=str(tmp_path))
    assert (tmp_path / "layout.svg").exists()
