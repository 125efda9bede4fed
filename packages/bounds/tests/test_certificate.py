"""Certificates: periods, and starts that are there already or out of reach."""

import pytest
from rans_bounds.certificate import (
    bounder,
    certified_least_fuel,
    certified_least_time,
)
from rans_bounds.plane.bounder import PlanarBounder
from rans_bounds.plane.lattice import Lattice
from rans_bounds.problem import Problem

from rans import ConfigError
from rans.model.spacecraft_file import load_spacecraft
from tests.support.states import planar
from tests.support.tiny_lattice import (
    PLATFORM,
)


def test_already_there_costs_nothing():
    rest = planar(heading=1.0)
    answer = certified_least_fuel(PlanarBounder(Lattice(PLATFORM, 0.2)), Problem(rest, rest), 5)
    assert (answer.lower, answer.upper) == (0.0, 0.0)


def test_out_of_reach_is_a_sentence():
    rest = planar()
    far = planar(30.0)
    with pytest.raises(ConfigError, match="too short a time"):
        certified_least_fuel(PlanarBounder(Lattice(PLATFORM, 0.2)), Problem(rest, far), 10)
    # 2 sqrt(30 m 5.32 kg / 2.83 N) = 15.02 s, less what the tolerances save.
    assert certified_least_time(
        PlanarBounder(Lattice(PLATFORM, 0.2)), Problem(rest, far), 6
    ).lower == pytest.approx(15.0)


@pytest.mark.parametrize(
    ("name", "told"),
    [("cubesat-3u", "cubesat-3u has others"), ("free-flyer", "pip install")],
)
def test_a_package_is_recommended_only_for_craft_that_it_covers(name, told, monkeypatch):
    monkeypatch.setattr("rans_bounds.certificate.BOUNDERS", {})
    with pytest.raises(ConfigError, match=told):
        bounder(load_spacecraft(name), 0.2)
