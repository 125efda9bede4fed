"""Figures are drawn whatever backend of matplotlib the environment names."""

import pytest

from tests.support.processes import printed

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


@pytest.mark.parametrize("name", ["no_such_package.backend", "matplotlib_inline.backend_inline"])
def test_a_backend_that_is_not_installed(name, tmp_path):
    """The second is of a notebook's kernel; a user's script keeps what it asks for."""
    then = printed("-c", PROGRAM, cwd=tmp_path, MPLBACKEND=f"module://{name}")
    assert (tmp_path / "layout.svg").read_text().rstrip().endswith("</svg>")
    if "no_such" in name:
        assert then.strip() == f"module://{name}"
