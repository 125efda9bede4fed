"""Files of tests whose library is not installed are passed over, and nothing else is."""

import sys
from pathlib import Path
from types import ModuleType

pytest_plugins = ["pytester"]

CONFTEST = Path(__file__).parents[1] / "conftest.py"


def test_only_what_lacks_an_optional_library_is_skipped(pytester, monkeypatch):
    """Drake is absent here; CasADi is there without such a module.

    A module of RANS that needs Drake raises an error of its own, which stopped the collection of 101 files.
    """
    monkeypatch.setitem(sys.modules, "pydrake", None)
    monkeypatch.setitem(sys.modules, "casadi", ModuleType("casadi"))
    pytester.makeconftest(CONFTEST.read_text("utf-8"))
    pytester.makepyfile(
        test_absent="import pydrake",
        test_behind_a_door="import rans.base.errors; rans.base.errors.require('pydrake')",
        test_misspelt="import casadi.nowhere",
        test_unknown="import no_such_library",
        test_good="def test_it(): pass",
    )
    run = pytester.runpytest_inprocess(
        "--import-mode=importlib",
        "--continue-on-collection-errors",
        "-rs",
        "-p",
        "no:cacheprovider",
    )
    run.assert_outcomes(passed=1, skipped=2, errors=2)
    printed = run.stdout.str()
    assert "needs pydrake" in printed
    assert "casadi.nowhere" in printed
    assert "No module named 'no_such_library'" in printed
