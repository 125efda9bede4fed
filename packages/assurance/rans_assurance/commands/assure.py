"""``rans assure``: bounds on the failure probability of an agent."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rans.extend import Options, Table, Terminal, command_of, say, word
from rans_assurance.functions import assure

if TYPE_CHECKING:
    from rans_assurance.assure.assurance import Assurance


@command_of(
    assure,
    without=("confidence", "worst", "seed", "device", "show"),
    agent=word("AGENT"),
)
class Assure(Options):
    """Bound the failure probability of an agent by Monte Carlo simulation, and fly the failures again.

    Writes assurance.json, of which `rans dossier` makes a page. Failed flights are repeated in NumPy and in
    Drake; `rans view` shows them. With --failure-below the exit code is 1 unless the bound
    was shown. Ctrl-C keeps what was flown.
    """

    group = "Judge"
    guide = "docs/assurance/assurance.md"
    divides_work = True
    examples = (
        "rans assure runs/my-agent --failure-below 1e-3",
        "rans assure runs/my-agent --conditions lab",
    )
    following = ("rans dossier {agent}",)

    def run(self) -> int:
        """Fly, repeat failed flights, write and print the results; 1 if an asked bound was not shown."""
        from rans.extend import ContestantName, contestant

        folder = self.output or ContestantName.parse(self.agent).output_folder
        assurance = self.call(output=folder, show=_show)
        campaign = assurance.campaign
        if campaign.failures:
            name = ContestantName.parse(self.agent)
            percent = 100.0 * (1.0 - campaign.failures / campaign.flights)
            if text := name.shortfall(percent, contestant(name, trust=self.trust), self.conditions):
                Terminal().say(text)
        is_shown = self.failure_below is None or assurance.campaign.decision == "below"
        return 0 if is_shown else 1


_NAMED = 3
"""Largest number of ranges of conditions in a sentence."""


def _show(assurance: Assurance) -> None:
    """Print what an assurance says, what it was asked, and the command that shows its worst failure."""
    console = Terminal(room=100)
    say(assurance.section, console)
    asked = [row for row in assurance.scope if row[0] != "conditions"]
    console.table(Table(("asked", "it is"), asked))
    # Of conditions there is a row a range, of a mixture a row a set.
    ranges = [text for what, text in assurance.scope if what == "conditions"]
    said = "; ".join(ranges[:_NAMED])
    more = len(ranges) - _NAMED
    console.say(
        f"Conditions: {said}{f'; and {more} more, see {assurance.file}' if more > 0 else ''}."
    )
    if assurance.replays and assurance.replays.found:
        worst_replay = max(assurance.replays.found, key=lambda replayed: replayed.excess)
        console.say(f"The worst failure, at {worst_replay.excess:.3g} tolerances:")
        console.command(assurance.view(worst_replay.number))
    assert assurance.file is not None
    console.say(f"Written to {assurance.file}.")
