"""The seam of bounders: with the package space has certificates; without it, the reason names the package."""

import tomllib
from importlib import import_module
from pathlib import Path

from rans_bounds.certificate import BOUNDERS, bounder
from rans_bounds.problem import SearchEffort
from rans_bounds.starts import bound, no_certificate, question
from rans_space_certificates.bounder import SpatialBounder

from rans import GoToPose
from rans.episode.scenario import each, scenarios
from rans.evaluation.compare.bounds import Event
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.goal_set import aims
from tests.support import plugins

plugins.register()

PROJECT = Path(__file__).parents[3] / "examples/plugins/space_certificates/pyproject.toml"
FLYER = load_spacecraft("free-flyer")
PLATFORM = load_spacecraft("floating-platform")
TASK = GoToPose(spawn_distance=(3.0, 3.1))


def test_the_entry_point_is_the_function_of_the_seam():
    [(group, names)] = tomllib.loads(PROJECT.read_text("utf-8"))["project"]["entry-points"].items()
    module, function = names["space"].split(":")
    assert (group, list(names)) == ("rans.bounds", ["space"])
    assert isinstance(getattr(import_module(module), function)(FLYER, 0.2), SpatialBounder)


def test_without_the_package_space_has_the_hull_bound_and_the_reason(monkeypatch):
    monkeypatch.setattr(BOUNDERS, "own", {})
    offered = {"plane": BOUNDERS._offered["plane"]}  # also where somebody has it installed
    monkeypatch.setattr(BOUNDERS, "_offered", offered)
    assert "examples/plugins/space_certificates" in no_certificate(FLYER, aims(TASK), 0.2)
    [scenario] = each(scenarios(TASK, FLYER, 5, 1))
    found = bound(0, question(FLYER, TASK, 0.2, Event(), SearchEffort(1e-9), scenario))
    assert found.lower is None
    assert found.best >= found.hull > 0.0
    assert bounder(PLATFORM, 0.2).craft == PLATFORM  # the plane needs no package
