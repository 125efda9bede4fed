"""Packages of this repository: the core knows none of them, and each says what it is."""

from __future__ import annotations

import ast
import importlib.metadata
import inspect
import pydoc
import re
import sysconfig
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

import rans
from rans import TASKS, extend
from rans.base.abilities import PUBLIC
from rans.base.display import meanings
from rans.base.registry import resolve
from rans.cli.commands import COMMANDS
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.model.spacecraft_file import SPACECRAFT

ROOT = Path(__file__).parents[1]
PACKAGES = sorted(file.parent for file in (ROOT / "packages").glob("*/README.md"))
NAMES = [f"rans_{folder.name}" for folder in PACKAGES]
DECLARED: dict[str, dict[str, str]] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))[
    "project"
]["entry-points"]
"""Entry points of the packages by group."""


def test_the_core_names_no_package():
    """Neither in an import, nor in a text that could become one, nor for type checkers."""
    word = re.compile("|".join(rf"\b{name}\b" for name in NAMES))
    found = [
        f"{file.relative_to(ROOT)}: {match[0]}"
        for file in [*(ROOT / "rans").rglob("*"), *(ROOT / "validation").rglob("*.py")]
        if file.suffix in (".py", ".toml", ".j2", ".js")
        for match in word.finditer(file.read_text("utf-8"))
    ]
    assert not found


def test_packages_do_not_name_one_another():
    for folder, own in zip(PACKAGES, NAMES, strict=True):
        others = re.compile("|".join(rf"\b{name}\b" for name in NAMES if name != own) or "(?!)")
        for file in (folder / own).rglob("*.py"):
            assert not others.search(file.read_text("utf-8")), file


def test_what_packages_add_is_loaded_and_is_of_rans():
    """Every entry point of the one distribution, whose packages are no strangers."""
    for group, entries in DECLARED.items():
        for name, reference in entries.items():
            assert resolve(reference, name), (group, name)
    for registry in (COMMANDS, CONTROLLERS, SPACECRAFT, TASKS):
        for name in registry:
            known = {n for g, own in DECLARED.items() if g.startswith(registry.group) for n in own}
            known |= registry.built_in.keys()
            assert registry.comes_with_rans(name) == (name in known)
    assert rans.read_opm is PUBLIC["read_opm"]


def test_extras_name_third_parties_alone():
    """No index has RANS: whoever took the name of one of its distributions there would run code at its users."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    own = {"rans", *(name.replace("_", "-") for name in NAMES), "rans-agents"}
    for lines in (project["dependencies"], *project["optional-dependencies"].values()):
        for line in lines:
            match = re.match(r"([\w-]+)(\[[\w,]+\])?", line)
            assert match
            name, extras = match.groups()
            # An extra may name others of the very distribution, which pip then does not look for.
            assert name not in own or (name == "rans" and extras), line


def test_tests_of_packages_are_modules_by_their_paths():
    """As packages of Python all of them would be `tests`, and two conftest.py one module, which ends pytest."""
    assert not list((ROOT / "packages").glob("*/tests/**/__init__.py"))


EXAMPLES = ROOT / "examples"
USERS = [
    *PACKAGES,
    *sorted(EXAMPLES.glob("plugins/*")),
    EXAMPLES / "plugin",
    EXAMPLES / "single_file",
]


def imported_from_the_core(folder: Path) -> Counter[tuple[str, str]]:
    """Modules of the core and names in them that a package imports, without its tests, and how often."""
    return Counter(
        (node.module, alias.name)
        for file in folder.rglob("*.py")
        if "tests" not in file.relative_to(folder).parts
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rans.")
        for alias in node.names
        if node.module
    )


def test_what_packages_build_on_is_named_in_one_module():
    """`rans.extend` has no name without a user or a docstring, and nobody goes round it."""
    homes = extend.homes(extend.__file__)
    assert len(homes) <= 225
    used = Counter()
    for folder in USERS:
        names = imported_from_the_core(folder)
        used.update(name for module, name in names if module == "rans.extend")
        assert not {(module, name) for module, name in names if homes.get(name) == module}, folder
        if folder.is_relative_to(EXAMPLES):
            assert {module for module, _ in names} <= {"rans.extend"}, folder
    assert homes.keys() == used.keys()
    for name in homes:
        value = getattr(extend, name)
        # Functions of fields are made by one maker, and have their texts where they are assigned.
        made = getattr(value, "__name__", "") == "<lambda>"
        if (isinstance(value, type) or inspect.isfunction(value)) and not made:
            assert value.__doc__, name


def test_help_has_the_fields_of_rows_that_packages_write():
    for row in (extend.Event, extend.Format, extend.Sample):
        told = pydoc.plain(pydoc.render_doc(row))
        fields = meanings(row)
        assert fields
        for name, text in fields.items():
            assert told.count(f"{name}: {text}") == 1


def test_tests_that_docstrings_name_exist():
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


def test_licences_that_ask_for_something_are_named():
    """Who distributes an image has to read them; permissive ones and those of files alone (MPL) are left out."""
    text = (ROOT / "SECURITY.md").read_text("utf-8")
    asking = re.compile(r"GPL|GNU|EPL|Eclipse|mosek\.com|(?<!Other/)Proprietary")
    unnamed = []
    for package in importlib.metadata.distributions(path=[sysconfig.get_path("purelib")]):
        about: Any = package.metadata  # a message of the email package
        fields = (about.get("License"), about.get("License-Expression"))
        licences = [*fields, *(x for x in about.get_all("Classifier") or () if "License" in x)]
        if asking.search(" ".join(str(x)[:100] for x in licences)) and package.name not in text:
            unnamed.append(package.name)
    assert unnamed == []
