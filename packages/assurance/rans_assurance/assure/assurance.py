"""Assurance of an agent: its setup, the number of flights and failures, and bounds on the failure probability.

`rans.assure` fills an `Assurance` step by step; its page, its JSON file and the command print what it holds.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from rans import Conditions, scenarios
from rans.episode.verdict import kinds_of_failure
from rans.evaluation.fly.agent import Agent
from rans.evaluation.fly.contestants import judged_separately
from rans.evaluation.fly.evidence import hashes
from rans.extend import (
    ConfigError,
    ContestantName,
    Failure,
    LoadedRun,
    Section,
    Stages,
    conditions_text,
    contestant,
    environment as this_environment,
    inside,
    unseen_stages,
    view_command,
)
from rans.randomization.conditions_file import conditions_label
from rans_assurance.assure.bounds import ProbabilityBound
from rans_assurance.assure.campaign import Campaign
from rans_assurance.assure.replay import Replays, replays
from rans_assurance.scope import scope
from rans_assurance.sections.assurance import assurance_section

_STARTS = 1000
"""Number of starts whose ranges are stated: their ends are within a thousandth or so of those of all starts."""


@dataclass
class Assurance:
    """Assurance of one agent: a campaign of flights, and what follows from it."""

    spec: str
    """Name of the agent, as `rans.evaluation.fly.contestants.contestant` takes it."""
    conditions: str | None
    """Name or file of the conditions, for texts; None: those of the training."""
    campaign: Campaign
    replays: Replays | None = None
    """Failed flights, flown again; None: not yet."""
    command: str = ""
    """Command line that made the assurance."""
    environment: dict[str, str] = field(default_factory=this_environment)
    """Environment of the machine that flew."""
    trust: bool = False
    """Whether the policy may be a pickle, which runs the code in it."""
    world: Conditions | None = None
    """The conditions of that name; None: those of the training."""
    given: LoadedRun | None = None
    """Agent or controller to fly instead of the one of that name."""
    file: Path | None = None
    """JSON file of the results, beside which the page is; None: nothing is written."""

    @cached_property
    def run(self) -> LoadedRun:
        """The agent with the setup of its evaluation.

        Raises:
            ConfigError: there is no such agent, or it has several tasks and none was picked.
        """
        if self.given is not None:
            return self.given.under(self.world)
        result = contestant(self.spec, trust=self.trust, conditions=self.world).under(self.world)
        if len(parts := judged_separately(self.spec)) > 1:
            raise ConfigError(
                f"{self.spec} has several tasks, and each is assured by itself: name one of "
                f"{', '.join(map(str, parts))}."
            )
        return result

    @cached_property
    def scope(self) -> list[tuple[str, str]]:
        """What the flights are asked, from which starts and under which conditions."""
        setup = self.run.judged
        return scope(setup, scenarios(setup.task, setup.craft, self.campaign.seed, _STARTS))

    @cached_property
    def hashes(self) -> dict[str, str]:
        """See `rans.evaluation.fly.evidence.hashes`."""
        return hashes(self.spec, self.run.judged)

    def __repr__(self) -> str:
        bound = self.campaign.bound()
        return (
            f"<Assurance of {self.spec}: {bound.events:,} of {bound.flights:,} flights failed, "
            f"probability of failure {bound.low:.2g} to {bound.high:.2g} at "
            f"{self.campaign.plan.confidence:.3g} confidence>"
        )

    @property
    def about(self) -> dict[str, Any]:
        """What decides how the flights of the campaign end, and how they are counted."""
        plan = self.campaign.plan
        return {
            "agent": self.spec,
            "conditions": conditions_text(self.run.conditions or Conditions()),
            "seed": self.campaign.seed,
            "confidence": plan.confidence,
            "below": plan.below,
            "looks": [
                [interim.flights, interim.high_level, interim.low_level] for interim in plan.looks
            ],
            "hashes": self.hashes,
        }

    def fly(
        self,
        device: str,
        stages: Stages = unseen_stages,
    ) -> None:
        """Count flights until the plan ends; see `Campaign.fly`."""
        controller = self.run.controller
        policy = controller.network if isinstance(controller, Agent) else controller
        self.campaign.fly(policy, self.run.judged, device, stages)

    def replay(self, most: int) -> None:
        """Fly failed flights again, see `rans_assurance.assure.replay.replays`."""
        numbers = {kind: some for kind in Failure if (some := self.campaign.numbers(kind))}
        self.replays = replays(
            self.run.controller, self.run.judged, self.campaign.seed, numbers, most
        )

    def view(self, number: int) -> str:
        """Command that shows a flight again."""
        return view_command([self.spec], self.run.task, self.conditions, number, self.campaign.seed)

    def write_into(self, folder: Path) -> None:
        """Have the results written into a folder, in a file for the task and the conditions that were named.

        Sets `file`, which the name of the task and a digest of the conditions decide.
        """
        part = label = ""
        with contextlib.suppress(ConfigError):  # an agent in memory may have any name
            part = ContestantName.parse(self.spec).part
        if self.conditions is not None:
            name = self.conditions or "own.toml"
            label = conditions_label(name, self.run.conditions or Conditions())
        stem = "-".join(filter(None, ("assurance", part, label)))
        self.file = inside(folder, f"{stem}.json")

    @property
    def section(self) -> Section:
        """What it says, as its file says it."""
        return assurance_section(self.file or Path("assurance.json"), self.to_json())

    def _repr_html_(self) -> str:
        from rans.extend import html_of

        return html_of(self.section)

    def to_json(self) -> dict[str, Any]:
        """Content of the JSON file, which pages read; `write_json` writes it."""
        campaign = self.campaign
        kinds = {
            "any": None,
            **{kind.name: kind for kind in kinds_of_failure(self.run.judged.task)},
        }
        return {
            "about": self.about,
            "campaign": campaign.to_json(),
            "scope": {"rows": self.scope},
            "decision": campaign.decision,
            "bounds": {name: _bound(campaign.bound(kind)) for name, kind in kinds.items()},
            "replays": self.replays
            and {
                "flown again": self.replays.tried,
                "failed again": self.replays.failed,
                "judged": [
                    replayed.to_json() | {"see": self.view(replayed.number)}
                    for replayed in self.replays.found
                ],
            },
            "command": self.command,
            "environment": self.environment,
        }


def _bound(bound: ProbabilityBound) -> dict[str, float]:
    return {
        "failures": bound.events,
        "flights": bound.flights,
        "rate": bound.rate,
        "at least": bound.low,
        "at most": bound.high,
    }
