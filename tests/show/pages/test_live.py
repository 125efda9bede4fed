"""The page of a flight that Python steps: its controls do what they say, and a browser flies it without Drake."""

from __future__ import annotations

import json
import re
import sys
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import pytest

from rans.api.pages import flyers
from rans.show.pages.live import Live
from rans.window import Served
from tests.support.browser import opened
from tests.support.processes import PATIENCE

SEED = 7
WORKS = ["ok"] * 8


def live(*names: str) -> Live:
    return Live(flyers(names, None, False), SEED, 3)


def ask(page: Live, what: str, value: Any = None, **controls: Any) -> dict[str, Any]:
    return page.answer(
        {"what": what, "value": value, "delay": 0, "noise": 0, "faults": WORKS} | controls
    )


def test_controls_do_what_they_say() -> None:
    page = live("lqr:go-to-pose-2d", "switching")
    begun = ask(page, "read")
    flown = [ask(page, "step") for _ in range(10)][-1]
    period = page.flight.world.timing.control_period
    assert flown["time"] == pytest.approx(10 * period)
    assert len(flown["poses"]) == page.flight.world.timing.checks
    assert flown["poses"][-1] == flown["carried"][:3]
    ask(page, "step", faults=["ok"] * 5 + ["dead", "stuck open", "ok"], noise=0.5, delay=1.5)
    assert (page.flight.dead, page.flight.stuck) == ({5}, {6})
    assert (page.flight.noise, page.flight.delay) == (0.5, 1.5)
    moved = ask(page, "goal", [1.0, -0.5, 0.3])
    size = len(moved["carried"]) // 2
    assert moved["carried"][size : size + 3] == [1.0, -0.5, 0.3]
    assert ask(page, "next")["name"] == "switching"
    back = ask(page, "rewind", 100)
    assert back["time"] == 0.0
    assert back["carried"][:3] == begun["carried"][:3]
    assert ask(page, "restart", 4)["number"] == 4


def test_a_command_that_is_late_by_a_fraction_is_a_mean() -> None:
    """Of the periods before and after, whose impulses it has."""
    page = live("lqr:go-to-pose-2d")
    first = ask(page, "step", delay=0.0)["command"]
    assert any(first)
    page = live("lqr:go-to-pose-2d")
    assert ask(page, "step", delay=0.25)["command"] == pytest.approx([0.75 * x for x in first])
    json.dumps(ask(page, "read"))


@pytest.mark.slow
def test_a_browser_flies_it_without_drake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Any controller in space too; what another address sends is refused."""
    monkeypatch.setitem(sys.modules, "pydrake", None)
    page = live("lqr:go-to-pose-3d")
    served = Served(page.html, range(7000, 7100), page.answer)
    found = re.search(
        r'role="status">(LQR · Start 3 · ([\d.]+) s · position .*?)<', opened(served.url, tmp_path)
    )
    assert found is not None
    assert float(found[2]) > 0.0
    assert page.flight.time > 0.0
    for content, kind in ((b"{}", "application/json"), (b"{}", "text/plain")):
        request = urllib.request.Request(
            f"{served.url}/flight", content, {"Content-Type": kind}, method="POST"
        )
        with pytest.raises(urllib.error.HTTPError, match="400"):
            urllib.request.urlopen(request, timeout=PATIENCE)
