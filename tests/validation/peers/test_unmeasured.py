from __future__ import annotations

from validation.peers.runner import PEERS
from validation.peers.unmeasured import UNMEASURED


def test_nobody_is_measured_and_not() -> None:
    names = [peer.package.lower() for peer in PEERS] + [row.name.lower() for row in UNMEASURED]
    assert len(names) == len(set(names))
