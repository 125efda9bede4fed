"""The seam of bounders: with the package space has certificates; without it, the reason names the package."""

import math
import tomllib
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest
from rans_bounds.certificate import BOUNDERS, bounder
from rans_bounds.problem import SearchEffort
from rans_bounds.starts import bound, no_certificate, question
from rans_space_certificates.bounder import SpatialBounder

from rans import GoToPose
from rans.episode.scenario import Scenario, each, scenarios
from rans.evaluation.compare.bounds import Event
from rans.model.fields import Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.goal_set import aims
from tests.support import plugins

plugins.register()

PROJECT = Path(__file__).parents[3] / "examples/plugins/space_certificates/pyproject.toml"
FLYER = load_spacecraft("free-flyer")
PLATFORM = load_spacecraft("floating-platform")
TASK = GoToPose(spawn_distance=(3.0, 3.1))


@pytest.mark.slow
def test_in_space_the_certificate_is_above_the_hull():
    assert no_certificate(FLYER, aims(TASK), 0.2) == ""
    asking = question(
        FLYER,
        TASK,
        0.2,
        Event(horizon=10.0),
        SearchEffort(1e-9),
        next(iter(each(scenarios(TASK, FLYER, 5, 1)))),
    )
    found = bound(0, asking)
    assert found.lower is not None
    assert found.hull < found.lower == found.best < 1.5 * found.hull
    assert found.upper == math.inf  # there was no time to look
    spinning = replace(asking.scenario.start, w=asking.scenario.start.w + Vec3(0.0, 0.0, 0.1))
    moved = bound(0, asking._replace(scenario=Scenario(spinning, asking.scenario.goal)))
    assert moved.lower is None  # no pulses stop 0.1 rad/s
    assert moved.best >= moved.hull > 0


def test_the_entry_point_is_the_function_of_the_seam():
    [(group, names)] = tomllib.loads(PROJECT.read_text("utf-8"))["project"]["entry-points"].items()
    module, function = names["space"].split(":")
    assert (group, list(names)) == ("rans.bounds", ["space"])
    assert isinstance(getattr(import_module(module), function)(FLYER, 0.2), SpatialBounder)


def test_without_the_package_space_has_the_hull_bound_and_the_reason(monkeypatch):
    monkeypatch.setattr(BOUNDERS, "own", {})
    monkeypatch.setattr(BOUNDERS, "_offered", {})  # of who has it installed
    assert "examples/plugins/space_certificates" in no_certificate(FLYER, aims(TASK), 0.2)
    [scenario] = each(scenarios(TASK, FLYER, 5, 1))
    found = bound(0, question(FLYER, TASK, 0.2, Event(), SearchEffort(1e-9), scenario))
    assert found.lower is None
    assert found.best >= found.hull > 0.0
    assert bounder(PLATFORM, 0.2).craft == PLATFORM  # the plane needs no package
