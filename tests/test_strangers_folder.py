"""A folder that a stranger filled: nothing in it is imported only because a command runs there."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.support.processes import printed

TRAP = """
import builtins
with builtins.open({!r}, "a") as file:
    file.write(__name__ + " ")
raise ImportError("a stranger's module was imported")
"""


@pytest.fixture
def folder(tmp_path) -> Path:
    """It holds a module of the name of every one of Python's library, and of packages that RANS imports."""
    made = tmp_path / "strangers"
    made.mkdir()
    others = (
        "torch",
        "numpy",
        "gymnasium",
        "cloudpickle",
        "cattrs",
        "rich",
        "tyro",
        "matplotlib",
        "pydrake",
    )
    library = (
        name for name in sys.stdlib_module_names if find_spec(name)
    )  # without other systems' parts
    for name in (*library, *others):
        (made / f"{name}.py").write_text(TRAP.format(str(tmp_path / "imported")))
    return made


def imported_in(folder: Path, *command: str | Path) -> str:
    """What Python prints there, which imports no module of the folder."""
    text = printed(*command, cwd=folder)
    marker = folder.parent / "imported"
    assert not marker.exists(), marker.read_text()
    return text


def test_python_m_rans(folder):
    """Except for what Python itself imports to find RANS, which nobody but ``python -P`` can help."""
    needed = printed("-P", "-c", "import runpy, sys; print(*sys.modules)")
    for name in needed.split():
        (folder / f"{name}.py").unlink(missing_ok=True)
    assert "floating-platform" in imported_in(folder, "-m", "rans", "list", "SPACECRAFT")


TYPED = """
from rans.base.processes import Workers
from rans.base.registry import resolve_typed
act = resolve_typed("my_plugin:act")
print(*Workers(int, (), 2).ordered(act, [(1,)]))
"""


def test_a_module_of_the_folder_that_was_typed_works_in_workers_too(folder, tmp_path):
    """Nothing else is imported there, nor by the process that keeps account of what is shared."""
    (folder / "my_plugin.py").write_text(
        "import random\n\ndef act(state, number):\n    return number + 41\n"
    )
    script = tmp_path / "script.py"
    script.write_text(TYPED)
    assert imported_in(folder, script) == "42\n"


def test_machine_code_of_the_folder(folder, tmp_path):
    """Its settings would have numba take functions from a cache of the folder, whose files are pickles."""
    (folder / ".numba_config.yaml").write_text("cache_dir: kept\n")
    script = tmp_path / "script.py"
    script.write_text("""
from rans_bounds.compiled import compiled

def double(number):
    return 2 * number

print(compiled(double)(21))
""")
    assert imported_in(folder, script) == "42\n"
    assert not (folder / "kept").exists()
