"""A watcher shows the agent of the newest checkpoint, and only when there is a new one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from rans.flight import Flight
from rans.model.fields import leaves
from rans.scenario import EVALUATION_SEED, scenarios
from rans.show import watch
from rans.show.pages.page import Page
from tests.support.training import tiny_trainer


class Stop(Exception):
    """Ends what goes on for ever."""


def test_new_agents_are_shown_once_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trainer = tiny_trainer(tmp_path / "run")
    shown = []
    pauses = []
    monkeypatch.setattr(watch, "open_browser", lambda url: None)
    page = watch.replay_page

    def shows(flights: Sequence[Flight], title: str) -> Page:
        shown.append(flights[0])
        return page(flights, title)

    monkeypatch.setattr(watch, "replay_page", shows)

    def sleep(seconds: float) -> None:
        """Time passes: nothing yet, a first agent, nothing new, another agent."""
        pauses.append(seconds)
        if len(pauses) == 2:
            trainer.save()
        if len(pauses) == 5:
            for weights in trainer.learner.network.tensors.values():
                weights.data.neg_()
            trainer.save()
        if len(pauses) == 9:
            raise Stop

    monkeypatch.setattr(watch.time, "sleep", sleep)
    with pytest.raises(Stop):
        watch.watch(trainer.run.path, port=0)  # any port that is free
    first, second = shown
    assert first.commands.shape[1] == second.commands.shape[1] == 4
    starts = [[x[0].tolist() for x in leaves(flight.states)] for flight in shown]
    assert starts[0] == starts[1]
    config = trainer.run.config()
    judged = scenarios(
        config.settings.for_evaluation(), trainer.run.spacecraft(), EVALUATION_SEED, 4
    )
    assert starts[0] == [x.tolist() for x in leaves(judged.start)]
    assert (first.commands != second.commands).any()
    assert pauses == [0.5, 0.5, 10.0, 0.5, 0.5, 10.0, 0.5, 0.5, 0.5]
