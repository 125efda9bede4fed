"""Packages of this repository: the core knows none of them, and each says what it is."""

from __future__ import annotations

import ast
import inspect
import re
import tomllib
from collections import Counter
from pathlib import Path

import pytest

import rans
from rans import extend
from rans.abilities import EXTRA_OF, PUBLIC
from rans.cli.commands import COMMANDS
from rans.deploy.export import EXPORTERS
from rans.deploy.forms import FORMATS
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.model.foreign import IMPORTERS
from rans.model.spacecraft_file import EFFECTORS, SPACECRAFT
from rans.policy.adaptation import ESTIMATORS
from rans.tasks import TASKS
from tests.support import packages

ROOT = Path(__file__).parents[1]
PACKAGES = sorted(file.parent for file in (ROOT / "packages").glob("*/pyproject.toml"))
NAMES = [f"rans_{folder.name}" for folder in PACKAGES]


def declared(folder: Path) -> dict[str, dict[str, str]]:
    """Entry points of a package by group."""
    return tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]["entry-points"]


def test_the_core_names_no_package() -> None:
    """Neither in an import, nor in a text that could become one, nor for type checkers."""
    word = re.compile("|".join(rf"\b{name}\b" for name in NAMES))
    found = [
        f"{file.relative_to(ROOT)}: {match[0]}"
        for file in [*(ROOT / "rans").rglob("*"), *(ROOT / "validation").rglob("*.py")]
        if file.suffix in (".py", ".toml", ".j2", ".js")
        for match in word.finditer(file.read_text("utf-8"))
    ]
    assert not found


def test_packages_do_not_name_one_another() -> None:
    for folder, own in zip(PACKAGES, NAMES, strict=True):
        others = re.compile("|".join(rf"\b{name}\b" for name in NAMES if name != own) or "(?!)")
        for file in (folder / own).rglob("*.py"):
            assert not others.search(file.read_text("utf-8")), file


@pytest.mark.parametrize(
    "folder",
    [packages.of(folder.name, folder) for folder in PACKAGES],
    ids=lambda folder: folder.name,
)
def test_what_a_package_adds_is_there_and_its_absence_names_its_extra(folder: Path) -> None:
    points = declared(folder)
    for name in points.get("rans.commands", {}):
        assert name in COMMANDS
        assert EXTRA_OF[name] == folder.name
    for name in points.get("rans.public", {}):
        assert getattr(rans, name) is PUBLIC[name]
        assert EXTRA_OF[name] == folder.name
    assert {name for name, extra in EXTRA_OF.items() if extra == folder.name} == {
        *points.get("rans.commands", {}),
        *points.get("rans.public", {}),
    }
    registries = {
        "rans.controllers": CONTROLLERS,
        "rans.estimators": ESTIMATORS,
        "rans.export_formats": FORMATS,
        "rans.exporters": EXPORTERS,
        "rans.importers": IMPORTERS,
        "rans.effector": EFFECTORS,
        "rans.spacecraft": SPACECRAFT,
        "rans.tasks": TASKS,
    }
    for group, registry in registries.items():
        for name in points.get(group, {}):
            assert registry[name]
            assert registry.comes_with_rans(name)
        assert {name for name, extra in registry.extra_of.items() if extra == folder.name} == {
            *points.get(group, {})
        }


@pytest.mark.parametrize("folder", PACKAGES, ids=lambda folder: folder.name)
def test_a_package_has_the_version_of_the_core_and_a_readme_of_a_screen(folder: Path) -> None:
    core = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    own = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
    assert own["version"] == core["version"]
    assert f"rans=={core['version']}" in own["dependencies"]
    assert core["optional-dependencies"][folder.name][0] == f"{own['name']}=={core['version']}"
    assert folder.name in core["optional-dependencies"]["all"][0]
    assert len((folder / "README.md").read_text("utf-8").splitlines()) <= 50


def test_tests_of_packages_are_modules_by_their_paths() -> None:
    """As packages of Python all of them would be `tests`, and two conftest.py one module, which ends pytest."""
    assert not list((ROOT / "packages").glob("*/tests/**/__init__.py"))


EXAMPLES = ROOT / "examples"
USERS = [
    *PACKAGES,
    *sorted(EXAMPLES.glob("plugins/*")),
    EXAMPLES / "plugin",
    EXAMPLES / "single_file",
]


def imported_from_the_core(folder: Path) -> set[tuple[str, str]]:
    """Modules of the core and names in them that a package imports, without its tests."""
    return {
        (node.module, alias.name)
        for file in folder.rglob("*.py")
        if "tests" not in file.relative_to(folder).parts
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rans.")
        for alias in node.names
        if node.module
    }


def test_what_two_packages_build_on_is_named_in_one_module() -> None:
    """`rans.extend` has few names, each with a docstring and two users, and nobody goes round it."""
    homes = extend.homes(extend.__file__)
    assert len(homes) <= 120
    used: Counter[str] = Counter()
    for folder in USERS:
        names = imported_from_the_core(folder)
        used.update({name for module, name in names if module == "rans.extend"})
        assert not {(module, name) for module, name in names if homes.get(name) == module}, folder
    assert {name for name in homes if used[name] < 2} == set()
    for name in homes:
        value = getattr(extend, name)
        # Functions of fields are made by one maker, and have their texts where they are assigned.
        made = getattr(value, "__name__", "") == "<lambda>"
        if (isinstance(value, type) or inspect.isfunction(value)) and not made:
            assert value.__doc__, name


def test_tests_that_docstrings_name_exist() -> None:
    """A reader of a function learns from its module which test would fail, by its path in repository or package."""
    files = [*ROOT.glob("rans/**/*.py"), *ROOT.glob("packages/*/rans_*/**/*.py")]
    named = [
        (file.relative_to(ROOT), path)
        for file in files
        for path in re.findall(r"`(tests(?:/\w+)+(?:\.py)?)`", file.read_text("utf-8"))
    ]
    assert len(named) > 20
    assert not [
        (file, path)
        for file, path in named
        if not any((ROOT / home / path).exists() for home in ("", *file.parents))
    ]
