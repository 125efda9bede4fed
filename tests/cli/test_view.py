"""``rans view`` from the command line."""

from __future__ import annotations

import re
import signal
import urllib.request
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rans import GoToPose
from rans.cli import main
from rans.episode.scenario import scenarios
from rans.model.spacecraft_file import load_spacecraft
from tests.support.processes import PATIENCE, command


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch) -> None:
    """Files go to a folder of the test's own, and no browser opens."""
    monkeypatch.chdir(tmp_path)
    for display in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(display, raising=False)


def test_a_page_in_which_an_agent_flies(ran, refused):
    printed = ran("view pretrained:go-to-pose-2d --play --save fly.html --episode 3")
    assert printed.startswith("fly.html (")
    assert "class Flight" in Path("fly.html").read_text()
    for wrong, said in (
        ("pretrained:go-to-pose-2d lqr --play --save fly.html", "one contestant"),
        ("lqr:go-to-pose-2d --play --save fly.txt", "page"),
        ("lqr:go-to-pose-2d --play", "no trained agent"),
    ):
        assert said in refused(f"view {wrong}")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "option", "said", "has"),
    [
        ("lqr:go-to-pose-2d", "", "LQR: shown at", b'class="race"'),
        ("go-to-pose-2d", "--play", "Fly along at", b"class Flight"),
    ],
)
def test_it_serves_until_it_is_interrupted(name, option, said, has):
    with command("view", name, *option.split()) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        url = re.search(rf"{said} (http://localhost:\S+) until Ctrl-C\.", line)
        assert url is not None, line
        with urllib.request.urlopen(url[1], timeout=PATIENCE) as page:
            assert has in page.read()
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, errors
        # Where flying takes long, lines say how far it is.
        assert "Traceback" not in errors
        assert "interrupted" not in errors


def test_every_option_reaches_the_flights(monkeypatch, capsys):
    """And of all flights the first is framed."""
    asked = []
    framed = []

    def flown(controller, setup, *given, first, endpoints, **others):
        starts = endpoints.applied(scenarios(setup.task, setup.craft, 8, 1))
        asked.append((controller.name, *given, first, float(starts.goal.p.x[0])))
        flight = SimpleNamespace(
            controller=controller.name,
            stopped=0,
            task=GoToPose(),
            craft=load_spacecraft("floating-platform"),
            verdict=SimpleNamespace(solved=np.ones(3, bool)),
        )
        return flight

    monkeypatch.setattr("rans.evaluation.fly.episodes.fly_episodes", flown)
    monkeypatch.setattr("rans.show.figures.figures.episode_figure", lambda flight: flight)
    monkeypatch.setattr(
        "rans.show.figures.picture_file.save_picture", lambda *given: framed.append(given)
    )
    options = "--episodes 3 --seed 8 --engine drake --save one.png --episode 4 --goal 1 0 0"
    assert main([*f"view lqr:go-to-pose-2d mpc:go-to-pose-2d {options}".split()]) == 0
    assert asked == [("LQR", 8, 3, "drake", 4, 1.0), ("MPC", 8, 3, "drake", 4, 1.0)]
    [(flight, file)] = framed
    assert (flight.controller, file) == ("LQR", Path("one.png"))
    assert capsys.readouterr().out.startswith("one.png shows LQR, MPC.\nNext:\n")
