"""Links of the Markdown pages that lead out of the site, which are right in the repository.

Pages link to files as a reader of the repository needs it: to the README, to examples. In the site
a link to the README leads to the landing page, one to a tutorial's script to its page, one to any other file
downloads it, and one to a folder is text.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.project import Project

_LINK = re.compile(r"(?P<picture>!?)\[(?P<text>[^\[\]]*)\]\((?P<target>[^)\s]+)\)")
_FENCE = re.compile(r"^(```|~~~).*?^\1", re.DOTALL | re.MULTILINE)


def _rewritten(app: Sphinx, docname: str, content: list[str]) -> None:
    """Change the links in the text of a page before it is parsed."""
    page = Path(app.env.doc2path(docname))
    if page.suffix != ".md":
        return
    docs = Path(app.srcdir)
    folder = page.resolve().parent  # a page of a package lies elsewhere in the repository

    def changed(link: re.Match[str]) -> str:
        text, target = link["text"], link["target"]
        path, mark, part = target.partition("#")
        if not path or "://" in path:
            return link[0]
        file = (docs / path[1:] if path.startswith("/") else folder / path).resolve()
        if file == docs.parent / "README.md":
            return f"[{text}](/index.md)"
        if file.is_relative_to(docs / "tutorials"):
            return f"[{text}](/learn/{file.stem}.rst)"
        if file.is_dir():
            return f"`{text.strip('`')}`"
        # A package's page is in packages/NAME/docs of the repository, and in docs/NAME of the site.
        for package in docs.parent.glob("packages/*/docs"):
            if file.is_relative_to(package):
                file = docs / package.parent.name / file.relative_to(package)
        # From the folder of the docs, because Sphinx would follow the link to a package's folder.
        within = f"/{os.path.relpath(file, docs)}"
        if link["picture"]:
            return f"![{text}]({within}{mark}{part})"
        if file.suffix in (".md", ".rst") and file.is_relative_to(docs):
            return f"[{text}]({within}{mark}{part})"
        return f"{{repository-file}}`{text.strip('`')} <{within}>`"  # downloaded

    pieces = []
    end = 0
    for fence in _FENCE.finditer(content[0]):
        pieces += [_LINK.sub(changed, content[0][end : fence.start()]), fence[0]]
        end = fence.end()
    content[0] = "".join([*pieces, _LINK.sub(changed, content[0][end:])])


def _file(
    name: str,
    rawtext: str,
    text: str,
    lineno: int,
    inliner: Any,
    options: Any = None,
    content: Any = (),
) -> tuple[list[nodes.Node], list[nodes.Node]]:
    """The role of a file of the repository: a download."""
    title, _, target = text.rstrip(">").rpartition(" <")
    node = addnodes.download_reference(rawtext, reftarget=target, refdoc="")
    node["refdoc"] = inliner.document.settings.env.docname
    node += nodes.literal(title, title)
    return [node], []


class _Linked(Project):
    """Names the pages of packages by their place in docs: Sphinx resolves symbolic links of targets."""

    def path2doc(self, filename: str | os.PathLike[str]) -> str | None:
        """Name of the page of a file; None: it is no page."""
        file = Path(filename)
        for link in Path(self.srcdir).iterdir():
            if link.is_symlink() and file.is_relative_to(link.resolve()):
                file = link / file.relative_to(link.resolve())
        return super().path2doc(file)


def _by_links(app: Sphinx) -> None:
    app.project.__class__ = _Linked


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to the reading of pages."""
    app.add_role("repository-file", _file)
    app.connect("builder-inited", _by_links)
    app.connect("source-read", _rewritten)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
