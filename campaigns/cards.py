"""Cards of the agents that come with RANS: their figures, flown again at the revision that is checked out.

`python -m campaigns.cards [NAME ...]`. What a card says of the training stays: the revision that
trained the weights is a fact of their history, and may be one with uncommitted changes. The figures name a
revision of their own, at which anybody gets them again; a working copy with changes is refused.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

from rans.base.errors import ConfigError
from rans.base.files import git_revision, write_json
from rans.base.pretrained import pretrained_card, pretrained_folder, pretrained_names
from rans.base.terminal import Terminal
from rans.deploy.export import evaluated

TOLD = ("solved", "settling time", "impulse")
"""Metrics whose changes are printed."""


def main(names: list[str]) -> None:
    """Write the cards of these agents, of all without any, and print what changed.

    Raises:
        ConfigError: the working copy has changes, or is none.
    """
    revision = git_revision()
    if revision == "unknown" or revision.endswith("-dirty"):
        raise ConfigError(f"cards are written from a clean checkout, and this is {revision}.")
    for name in names or pretrained_names():
        card = pretrained_card(name)
        new = evaluated(
            f"pretrained:{name}",
            tuple(card["evaluation"]),
            card["episodes"],
            card["evaluation_seed"],
        )
        new["evaluation_environment"]["revision"] = revision  # cards written before are changes now
        changes = [*_changes(card["evaluation"], new["evaluation"])]
        write_json(pretrained_folder(name) / "card.json", card | new)
        Terminal().say(f"{name}: {'; '.join(changes) or 'the same figures'}.")


def _changes(before: dict[str, Any], after: dict[str, Any]) -> Iterator[str]:
    """What differs in the first four digits."""
    for protocol, parts in before.items():
        for part, metrics in parts.items():
            for metric in TOLD:
                old = metrics.get(metric)
                new = after[protocol][part].get(metric)
                if old and new and f"{old[0]:.4g}" != f"{new[0]:.4g}":
                    yield f"{protocol} {part} {metric} {old[0]:.4g} -> {new[0]:.4g}".replace(
                        "  ", " "
                    )


if __name__ == "__main__":
    main(sys.argv[1:])
