"""``rans assure``: bounds on the failure probability of an agent."""

from __future__ import annotations

import shlex
import time
from pathlib import Path
from typing import TYPE_CHECKING

from rans.cli.door import Options, command_of, word
from rans.extend import (
    ConfigError,
    Terminal,
    check_count,
    doing,
    inside,
    progress,
    ready_folder,
    stages,
    write_json,
)
from rans.files import command_line
from rans.scenario import ASSURANCE_SEED
from rans.terminal import writing_at_end
from rans_assurance.functions import assure

if TYPE_CHECKING:
    from rans_assurance.assure.assurance import Assurance

_EPISODES = 100_000
_CONFIDENCE = 0.99
_WORST = 4
"""Failed flights of each kind that are repeated."""
_MARKS = {True: "Pass: ", False: "FAIL: ", None: "Note: "}
_KEPT = 10.0
"""Seconds between two writes of the results so far."""


@command_of(
    assure,
    without=("confidence", "worst", "seed", "device"),
    agent=word("AGENT"),
)
class Assure(Options):
    """Bound the failure probability of an agent by Monte Carlo simulation, and fly the failures again.

    Writes assurance.json and assurance.html, a report with lines for signatures. Failed flights are repeated
    in NumPy and in Drake; `rans view` shows them. With --failure-below the exit code is 1 unless the bound
    was shown. Ctrl-C keeps what was flown, and the same command continues. --gpus all divides the flights
    among GPUs. --episodes 0 flies nothing, and prints how many flights the campaign takes.
    """

    group = "Judge"
    guide = "docs/assurance/assurance.md"
    divides_work = True
    examples = (
        "rans assure runs/first --failure-below 1e-3",
        "rans assure runs/first --conditions lab --search lab",
    )

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return (shlex.join(["rans", "stress", self.agent]),)

    def run(self) -> int:
        """Fly, repeat failed flights, write and print the results."""
        from rans.api.names import conditions_if_named
        from rans.extend import Conditions, ContestantName, load_conditions
        from rans.randomization.conditions_file import conditions_label
        from rans_assurance.assure.assurance import made
        from rans_assurance.assure.bounds import plan
        from rans_assurance.assure.rare import check_rare_count as check_rare
        from rans_assurance.assure.search import check_unit

        is_plan = self.episodes == 0
        episode_count = self.episodes or None  # 0 asks for the plan with the default number
        check_count("--episodes", episode_count)
        if self.rare < 0:
            raise ConfigError(f"--rare must be >= 0, got {self.rare}.")
        if self.rare:
            check_rare("--rare", self.rare)
        if self.search:
            check_unit(
                self.search, load_conditions(self.search)
            )  # reject a wrong name before the flights
        episodes = (
            _EPISODES if episode_count is None and self.failure_below is None else episode_count
        )
        planned = plan(_CONFIDENCE, episodes, self.failure_below)
        assurance = made(
            self.agent,
            self.conditions,
            conditions_if_named(self.conditions),
            planned,
            ASSURANCE_SEED,
            command_line(),
            self.trust,
        )
        if is_plan:
            _print_plan(assurance)
            return 0
        assurance.check_follow_ups(self.rare, self.search)
        name = ContestantName.parse(self.agent)
        folder = ready_folder(self.output or name.output_folder)
        conditions = ""
        if self.conditions is not None:
            conditions = conditions_label(self.conditions, assurance.run.conditions or Conditions())
        names = "assurance", name.part, conditions
        file = inside(folder, f"{'-'.join(filter(None, names))}.json")
        assurance.check_replaces_nothing(file)
        first = self._fly(assurance, file)
        is_shown = self.failure_below is None or assurance.campaign.decision == "below"
        return 0 if is_shown or not first else 1

    def _fly(self, assurance: Assurance, file: Path) -> bool:
        """Fly until the plan ends; the results so far are written and printed even after an error.

        Returns whether this is the first of torchrun's processes; the others only fly.
        """
        from rans.extend import load_conditions, torch_device
        from rans.fast.distributed import join

        device = torch_device()
        campaign = assurance.campaign
        written = time.monotonic()
        processes = join(device, apart=True)
        if not processes.is_first:
            assurance.fly(device, processes=processes)
            return False

        def keep() -> None:
            nonlocal written
            if time.monotonic() - written > _KEPT:
                write_json(file, assurance.to_json())
                written = time.monotonic()

        def show() -> None:
            if campaign.flights:
                _show(assurance, file)

        assurance.go_on(file)
        with writing_at_end(show), progress() as bars:
            stage = stages(bars)
            assurance.fly(device, stage, keep, processes)
            stage("failed flights again", None)
            assurance.replay(_WORST, _WORST)
            if self.rare:
                stage("rarer failures", None)
                assurance.sample(self.rare, device)
            if self.search:
                stage("the worst case", None)
                assurance.search(self.search, load_conditions(self.search), device)
        return True


def _show(assurance: Assurance, file: Path) -> None:
    from rans_assurance.pages.assure_counts import counts, decision_sentence
    from rans_assurance.pages.assure_page import assurance_page, findings

    result = assurance.to_json()
    write_json(file, result)
    worst = ""
    if assurance.searched and assurance.searched.breaking:
        from rans.show.pages.replay import replay_page

        worst = f"{file.stem}-worst-case.html"
        replay_page([assurance.searched.breaking.flight], "Worst case").write(file.with_name(worst))
    with doing("drawing the page", in_log=False):
        assurance_page(assurance, worst).write(file.with_suffix(".html"))
    console = Terminal(room=100)
    campaign = assurance.campaign
    table = counts(result)
    words = [
        "any failure",
        *(name.lower().replace("_", " ") for name in result["bounds"] if name != "any"),
    ]
    console.show(
        f"{assurance.spec}: {campaign.flights:,} flights of seed {campaign.seed}",
        table.columns,
        table.rows,
        [(word, *row[1:]) for word, row in zip(words, table.rows, strict=True)],
        "A wider terminal says what each of them means, as the page does.",
    )
    console.say(decision_sentence(result))
    console.say(assurance.scope.sentence.replace(", see below", ", see the page"))
    for finding in findings(assurance):
        console.say(f"{_MARKS[finding.passed]}{finding.text}.")
    if assurance.searched:
        console.say(f"In a search {assurance.searched.summary}.")
    if assurance.rare:
        console.say(f"By subset simulation {assurance.rare.summary}.")
    if assurance.replays and assurance.replays.found:
        worst_replay = max(assurance.replays.found, key=lambda replayed: replayed.excess)
        console.say(f"The worst failure, at {worst_replay.excess:.3g} tolerances:")
        console.command(assurance.view(worst_replay.number))
    others = ", ".join(name for name in (file.with_suffix(".html").name, worst) if name)
    console.say(f"Written to {file}, {others}.")


def _print_plan(assurance: Assurance) -> None:
    plan = assurance.campaign.plan
    rows = [
        (
            f"{look.flights:,}",
            f"at most {allowed:,}" if (allowed := plan.allowed(look)) >= 0 else "-",
            f"{look.high_level:.2g}",
            f"{look.low_level:.2g}",
        )
        for look in plan.looks
    ]
    chances = ("chance of error, at most", "chance of error, at least")
    columns = ("flights", "failures that show the bound", *chances)
    Terminal(room=100).show(f"At {plan.confidence:g} confidence", columns, rows)
