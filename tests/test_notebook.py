"""The notebook of the examples runs from top to bottom, without a training and without Jupyter."""

import json
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from rans.base.files import package_version
from rans.base.table import Table
from rans.show.pages.notebook import html_of
from rans.show.pages.page import Page, Section

NOTEBOOK = Path(__file__).parents[1] / "examples" / "notebook" / "first_agent.ipynb"
TRAINED = 'rans.train("go-to-pose", output="first")'


def test_its_wheel_is_the_one_that_is_built():
    assert f"/rans-{package_version('rans')}-py3" in NOTEBOOK.read_text("utf-8")


@pytest.mark.slow
def test_the_notebook_runs_from_top_to_bottom(here, monkeypatch):
    """Every value that a cell shows has a form for notebooks."""
    display = ModuleType("IPython.display")
    monkeypatch.setattr(display, "HTML", str, raising=False)
    package = ModuleType("IPython")
    # Matplotlib asks a module of this name.
    monkeypatch.setattr(package, "version_info", (9, 0), raising=False)
    monkeypatch.setattr(package, "get_ipython", lambda: None, raising=False)
    monkeypatch.setitem(sys.modules, "IPython", package)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    cells = json.loads(NOTEBOOK.read_text("utf-8"))["cells"]
    codes = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert sum(TRAINED in code for code in codes) == 1
    names = {}
    for code in codes:
        *body, last = code.replace(TRAINED, 'rans.load_agent("go-to-pose-2d")').split("\n")
        exec("\n".join(body).replace("episodes=256", "episodes=8"), names)
        shown = eval(last.replace("episodes=256", "episodes=8"), names)
        assert isinstance(shown, str) or "<" in shown._repr_html_()
    assert (here / "fly.html").is_file()


def test_the_notebook_has_no_outputs():
    """Outputs change with every run, and are large."""
    cells = json.loads(NOTEBOOK.read_text("utf-8"))["cells"]
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)


def test_a_notebook_has_the_table_of_a_page():
    """One renderer: numbers stand right and truth values are verdicts in both, and texts are no mark-up."""
    table = Table(("name", "value", "passed"), [("<b>", 1.5, False), ("b", None, True)], "T")
    whole = re.compile(r"<table>.*</table>", re.DOTALL)
    (in_page,) = whole.findall(Page("page", [Section("s", tables=[table])]).html())
    assert whole.findall(html_of(table)) == [in_page]
    assert "&lt;b&gt;" in in_page
