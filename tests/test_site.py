"""The documentation site without building it: every page is reached, terms lead to pages, words are the field's."""

from __future__ import annotations

import doctest
import re
import sys
import tempfile
from pathlib import Path
from types import ModuleType

import pytest

from tests.support.scripts import module_of

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


sys.path.append(str(DOCS / "_ext"))  # as docs/conf.py does


def extension(name: str) -> ModuleType:
    """A module of docs/_ext, which is no package."""
    return module_of(DOCS / "_ext" / f"{name}.py")


PROSE = extension("prose")
REFERENCE = extension("reference")
SEARCH = extension("search_words")
STATES = extension("states")


def entries(page: Path) -> list[str]:
    """Pages that a page's tables of contents lead to, as paths below docs without their ends."""
    folder = page.parent.relative_to(DOCS).as_posix()
    listed = []
    for body in re.findall(
        r"^```\{toctree\}\n(.*?)^```", page.read_text("utf-8"), re.DOTALL | re.MULTILINE
    ):
        names = [line for line in body.splitlines() if line and not line.startswith(":")]
        for name in names:
            if "*" in name:
                listed += [
                    one.relative_to(DOCS).with_suffix("").as_posix()
                    for one in page.parent.glob(f"{name}.md")
                ]
            else:
                listed.append((f"{folder}/" if folder != "." else "") + name)
    return listed


@pytest.fixture(scope="module")
def generated_pages() -> dict[str, str]:
    """The pages that are written from the code, without their pictures, which `make docs` draws."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(REFERENCE, "save_task_picture", lambda *_: "")
        patch.setattr(REFERENCE, "save_picture", lambda *_: None)
        patch.setattr(REFERENCE, "PICTURES", Path(tempfile.mkdtemp()))
        return REFERENCE.pages()


@pytest.mark.slow
def test_every_page_is_in_one_table_of_contents(generated_pages):
    generated = {Path(name).with_suffix("").as_posix() for name in generated_pages}
    reached = ["index"]
    for page in reached:
        if (DOCS / f"{page}.md").exists():
            reached += entries(DOCS / f"{page}.md")
        else:  # written by the build
            assert page == "learn/index" or page.removeprefix("reference/") in generated, page
    assert len(reached) == len(set(reached))
    written = {
        page.relative_to(DOCS).with_suffix("").as_posix()
        for page in DOCS.rglob("*.md")
        if page.relative_to(DOCS).parts[0] not in ("learn", "reference", "validation")
    }
    written |= {
        f"{docs.parent.name}/{page.relative_to(docs).with_suffix('').as_posix()}"
        for docs in ROOT.glob("packages/*/docs")
        for page in docs.rglob("*.md")
    }
    assert written <= set(reached)


@pytest.mark.slow
def test_the_reference_has_every_public_name_command_task_and_spacecraft(generated_pages):
    REFERENCE.check_api()
    made = generated_pages
    for name in REFERENCE.COMMANDS:
        assert f"### rans {name}\n" in made["commands.md"]
    for name in filter(REFERENCE.TASKS.comes_with_rans, REFERENCE.TASKS):
        assert "Observation in" in made[f"tasks/{name}.md"]
    for name in REFERENCE.spacecraft_names():
        assert f"## {name}\n" in made["spacecraft.md"]


def test_the_example_of_states_runs():
    finder = doctest.DocTestParser()
    example = finder.get_doctest(STATES.EXAMPLE, {}, "EXAMPLE", None, None)
    assert doctest.DocTestRunner().run(example) == (0, 9)


def test_every_hidden_word_is_of_one_page():
    words = [word for several in SEARCH.WORDS.values() for word in several]
    assert len(set(words)) == len(words)
    assert all(word == word.lower().strip() and not set(";!") & set(word) for word in words)
    assert all((DOCS / f"{page}.md").exists() for page in SEARCH.WORDS)
    # Typed by strangers to RANS, who found nothing or the records of decisions.
    found_nothing = "sim2real PWM PID hyperparameter rosbag TorchScript Docker conda URDF MATLAB"
    found_records = ["docking", "reward function", "ROS 2", "early stopping", "limitations"]
    assert {word.lower() for word in (*found_nothing.split(), *found_records)} <= set(words)


def test_pages_that_are_exempt_exist():
    for name in PROSE.NOT_YET:
        assert (ROOT / name).exists(), f"{name} is gone: remove it from NOT_YET"


def test_foreign_addresses_that_a_page_would_fetch_are_seen():
    fetched = extension("self_contained").fetched
    assert fetched('<link href="https://fonts.example/a.css" rel="stylesheet">')
    assert fetched("@font-face { src: url(//cdn.example/a.woff) }")
    assert not fetched('<a href="https://example.org">a link is followed by the reader alone</a>')
