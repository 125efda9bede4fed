from __future__ import annotations

from pathlib import Path

from validation.peers.runner import PEERS
from validation.peers.unmeasured import UNMEASURED

PAGE = (Path(__file__).parents[3] / "docs" / "speed.md").read_text("utf-8")


def test_nobody_is_measured_and_not() -> None:
    names = [peer.package.lower() for peer in PEERS] + [row.name.lower() for row in UNMEASURED]
    assert len(names) == len(set(names))


def test_the_page_has_who_is_not_measured_and_why() -> None:
    for row in UNMEASURED:
        assert f"| {row.name} | {row.reason} | {row.tried} |" in PAGE


def test_the_page_has_the_versions_that_are_measured() -> None:
    for peer in PEERS:
        for requirement in peer.requirements[:1]:
            assert f" {requirement.rpartition('==')[2]} |" in PAGE, peer.package
