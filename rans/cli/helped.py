"""What ``--help`` says, with words kept whole: tyro leaves that to the terminal, which breaks them."""

from __future__ import annotations

import io
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable
from contextlib import redirect_stdout
from typing import Annotated, Any, get_type_hints

from rans.display import meanings

_STYLES = re.compile(r"\x1b\[[0-9;]*m")


class _Page(io.TextIOWrapper):
    """Is printed later, on what stands for the output now: in its letters and colours."""

    def __init__(self) -> None:
        super().__init__(
            io.BytesIO(), encoding=(sys.stdout.encoding or "utf-8").lower(), errors="replace"
        )
        self.isatty = sys.stdout.isatty


def helped(parse: Callable[[], Any], commands: Iterable[type]) -> Any:
    """What ``parse`` gives; the help that it prints is wrapped."""
    explain(commands)
    page = _Page()
    try:
        with redirect_stdout(page):
            return parse()
    finally:
        page.seek(0)
        width = shutil.get_terminal_size().columns
        text = "\n".join(_wrapped(line, width) for line in page.read().splitlines())
        print(re.sub(r"\n{3,}", "\n\n", text))


def explain(commands: Iterable[type]) -> None:
    """Give tyro the texts of fields in one line each: it takes the second line of one for a new paragraph."""
    from typing_extensions import Doc

    for described in commands:
        hints = get_type_hints(described, include_extras=True)
        texts = meanings(described)
        described.__annotations__ = {
            name: Annotated[hint, Doc(texts[name])] if name in texts else hint
            for name, hint in hints.items()
        }


def _wrapped(line: str, width: int) -> str:
    """Lines of boxes, which fit, as they are."""
    plain = _STYLES.sub("", line)
    if len(plain) <= width or plain[:1] in "╭│╰":
        return line
    names = re.sub(r"\{[\w,]{40,}\}", "COMMAND ...", plain)  # they are told below
    return textwrap.fill(names, width, break_long_words=False, break_on_hyphens=False)
