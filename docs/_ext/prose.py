"""A linter of the pages' words: `python docs/_ext/prose.py`, a part of `make lint`.

Pages for users are written in the field's words, so that a search finds them, and at a length that is read. What
stands in code and in links' targets is not read.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"

WORDS = {
    r"knobs?": "trade-off input",
    r"thrust-times?": "impulse",
    r"verge": "boundary penalty",
    r"troubles?": "perturbation, or fault",
    r"(?<!line-of-)(?<!line of )sight": "observation",
    r"rosters?": "list",
    r"guests?": "extension",
    r"perfect world|worlds": "nominal conditions, or scenarios",
    r"world that": "conditions that",
    r"in its mind": "in its model",
    r"felt from afar": "long-range shaping",
    r"swings? to and fro|to and fro": "sinusoidal, or alternating",
    r"kicks?": "impulse",
    r"in a blink": "the time in seconds",
    r"at rest for good|first at rest|(?:holds?|held) (?:the|its|their) goals?": "solved, or settled",
    r"randomis\w+|normalis\w+|optimis\w+|minimis\w+|maximis\w+|synchronis\w+|visualis\w+": "American z",
}
"""Words that are private, old or of another spelling, each with what to write instead."""

MOST_WORDS = 800
"""Largest number of words of a how-to page or a page of decisions, without code and tables."""

MOST_OF_CORE = 30_000
"""Largest number of words of the core's own pages together, with their tables and without code."""

NOT_YET = frozenset[str]()
"""Pages that still have such words, or are longer: to be rewritten, and then to be removed from here."""

INTERNAL = frozenset(
    {
        "architecture.md",
        "certificate.md",
        "measured.md",
        "plain.md",
        "speed.md",
        "validation.md",
    }
)
"""Pages for those who change RANS or read proofs: as long as they need."""

REFERENCE = frozenset(
    {"agents.md", "assurances.md", "protocol.md", "raft.md", "robustness.md", "tasks.md"}
)
"""Pages of tables and definitions, which are looked up and not read: as long as they need."""


def pages() -> list[Path]:
    """Pages that are checked: the READMEs, those of docs, packages and decisions, and the tutorials."""
    return [
        ROOT / "README.md",
        *sorted(ROOT.glob("packages/*/README.md")),
        *sorted(ROOT.glob("examples/**/README.md")),
        *sorted(page for page in DOCS.glob("*.md") if page.name not in INTERNAL),
        *sorted(ROOT.glob("packages/*/docs/*.md")),
        *sorted(DOCS.glob("decisions/*.md")),
        *sorted(DOCS.glob("tutorials/*.py")),
    ]


def prose(text: str, is_script: bool = False) -> str:
    """A page without its code, with as many lines, in which code and targets of links are blank.

    >>> prose("See [the knob](knob.md) and `knob`.")
    'See [the knob]() and .'
    """
    if is_script:
        text = "\n".join(
            line.lstrip("# ") if line.startswith("#") else "" for line in _docstring_first(text)
        )
    text = re.sub(
        r"^(```|~~~).*?^\1",
        lambda code: "\n" * code[0].count("\n"),
        text,
        flags=re.DOTALL | re.MULTILINE,
    )
    text = re.sub(r"^    .*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"<!--.*?-->", "", text)
    text = re.sub(r"``[^`]*``|`[^`]*`", "", text)
    return re.sub(r"\]\([^)]*\)", "]()", text)


def _docstring_first(text: str) -> Iterator[str]:
    """Lines of a script, those of its docstring as comments."""
    inside = False
    for k, line in enumerate(text.splitlines()):
        quotes = line.count('"""')
        if k == 0 or inside:
            inside = quotes % 2 == 1 if k == 0 else not quotes
            yield f"# {line}"
        else:
            yield line


def complaints(page: Path) -> Iterator[str]:
    """What is wrong with a page, a sentence each that begins with its place."""
    name = page.relative_to(ROOT).as_posix()
    text = prose(page.read_text("utf-8"), page.suffix == ".py")
    for number, line in enumerate(text.splitlines(), 1):
        for pattern, better in WORDS.items():
            for word in re.findall(rf"\b(?:{pattern})\b", line, re.IGNORECASE):
                yield f'{name}:{number}: "{word}" is not a word of the field; write: {better}.'
    sentences = re.sub(r"^\|.*$", "", text, flags=re.MULTILINE)
    count = words(sentences)
    if (
        (page.parent == DOCS or page.parent.name == "decisions")
        and page.name not in REFERENCE
        and count > MOST_WORDS
    ):
        yield f"{name}: {count} words; a page that is read has at most {MOST_WORDS}: split it."


def words(text: str) -> int:
    """Number of words of a page without its code.

    >>> words("A wheel stores 0.0236 N m s.")
    7
    """
    return len(re.findall(r"\w[\w'.,-]*", text))


def words_of_core() -> int:
    """Number of words in README, CONTRIBUTING and the pages in docs itself, without those of packages."""
    own = ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS.glob("*.md")
    return sum(words(prose(page.read_text("utf-8"))) for page in own)


def main() -> int:
    """Print the complaints about all pages: 0 if there are none."""
    found = [
        complaint
        for page in pages()
        if page.relative_to(ROOT).as_posix() not in NOT_YET
        for complaint in complaints(page)
    ]
    if (count := words_of_core()) > MOST_OF_CORE:
        found.append(
            f"The core's pages have {count:,} words, at most {MOST_OF_CORE:,}: what a package adds is on "
            "its own pages, and each thing is said once."
        )
    for complaint in found:
        sys.stdout.write(f"{complaint}\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
