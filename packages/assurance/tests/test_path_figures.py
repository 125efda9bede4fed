"""What the figure of flights along a path draws, of motion made up by hand."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from rans_assurance.figures.path_figures import following_figure
from rans_assurance.follow.paths import LookAhead, helix

from rans.show.palette import BLUE, GREY

from .path_flights import FLYER, by_hand, flown


def lines(axes: Axes) -> dict[str, np.ndarray]:
    return {str(line.get_label()): np.asarray(line.get_xydata()) for line in axes.get_lines()}


def bold(axes: Axes) -> np.ndarray:
    """Of the flight that is drawn in full."""
    (found,) = (line for line in axes.get_lines() if line.get_color() == BLUE)
    return np.asarray(found.get_xydata())


@pytest.mark.parametrize(
    ("number", "instants"), [(0, 6), (1, 7)]
)  # the first arrives after five periods
def test_the_figure_shows_path_velocities_and_distances(number: int, instants: int) -> None:
    following = by_hand()
    following.flight.goals.v.x[:, 1] = 0.2  # each has commands of its own
    ways, v_x, v_y, _ = following_figure(following, number).axes
    drawn = lines(ways)
    np.testing.assert_allclose(drawn["path"][[0, -1]], [(0, 0), (2, 0)])
    np.testing.assert_allclose(drawn[f"flight {number}"], following.positions[:instants, number])
    assert drawn["its start"].tolist() == [[0.0, 0.9]]
    for axes, axis in ((v_x, 0), (v_y, 1)):
        times = np.arange(instants) * 0.5
        velocity = following.velocities[:instants, number, axis]
        command = following.commands[: instants - 1, number, axis]
        np.testing.assert_allclose(lines(axes)["flown"], np.stack((times, velocity), axis=1))
        np.testing.assert_allclose(lines(axes)["command"], np.stack((times[:-1], command), axis=1))
    assert v_x.get_title(loc="left") == f"(b) velocity of flight {number} and its commands"


def test_distances_are_in_centimetres_and_the_approach_is_marked() -> None:
    """The first flight is 3 and then 4 cm beside the line; the other 20 cm, in its last instant."""
    *_, distances = following_figure(by_hand()).axes
    np.testing.assert_allclose(
        bold(distances)[1:], [(0.5, 3), (1.0, 3), (1.5, 4), (2.0, 4)], atol=1e-9
    )
    assert (distances.get_xlabel(), distances.get_ylabel()) == ("time, s", "cm")
    rms = 0.5 * (np.sqrt(12.5) + 20.0)  # of 3, 3, 4 and 4 cm, and of 20 cm
    assert lines(distances)["mean RMS, 12 cm"][:, 1] == pytest.approx([rms, rms])
    (approach,) = distances.patches
    low, high = approach.get_extents().transformed(distances.transData.inverted()).intervalx
    assert (low, high) == pytest.approx(
        (0.0, 0.5)
    )  # it counts from 0.4 m on, where it is after 0.5 s
    assert approach.get_label() == "approach of flight 0, not measured"


def test_one_flight_stands_out() -> None:
    ways, *_ = following_figure(by_hand(), 1).axes
    colours = [to_hex(str(line.get_color())).upper() for line in ways.get_lines()[1:3]]
    assert colours == [GREY.upper(), BLUE.upper()]
    assert ways.get_title(loc="left") == "(a) line, 2 flights"


def test_a_spatial_figure_has_three_velocities() -> None:
    following = flown(LookAhead(helix(0.75, 0.3, 0.2)), FLYER, count=2)
    ways, *stack = following_figure(following).axes
    assert ways.name == "3d"
    assert [axes.get_ylabel() for axes in stack] == ["v_x, m/s", "v_y, m/s", "v_z, m/s", "cm"]
