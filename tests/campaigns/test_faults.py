"""The table of faults, against the flights that evaluations are made of and numbers worked by hand."""

from campaigns.batch import flown, loaded
from campaigns.faults import bounds, rows
from rans import Conditions, FaultConditions
from rans.model.spacecraft_file import load_spacecraft

AGENT = "pretrained:go-to-pose-2d"
PAIRS = FaultConditions(2.0, ("dead", "stuck-open"), time=0.0, among="recoverable")


def test_what_is_lost_stays_where_it_was_lost():
    """Two thrusters stuck open that cannot be balanced push 1 to 2 N: 8 m are soon gone."""
    network, setup = loaded(AGENT, "cpu")
    unheld = Conditions(faults=FaultConditions(2.0, ("stuck-open",), among="unrecoverable"))
    found = flown(network, setup, unheld, 48, 7, "cpu")
    assert 0 < found.lost.sum() < 48
    # Seen last in the period before, in which it moves by less than 2.5 m/s * 0.2 s.
    assert (found.distance[found.lost] > 7.5).all()
    assert found.distance.max() < 8.0
    assert not found.held[found.lost].any()


def test_rows_are_every_class_that_the_craft_has():
    found = list(rows(load_spacecraft("floating-platform"), 25.0))
    assert [row.name for row in found if "," not in row.name] == ["none"]
    at_once = [row.name for row in found if row.at_start]
    assert [name.replace(", ", " ").replace("recoverable ", "") for name in at_once[1:]] == [
        "one dead (8)",
        "one stuck-open (8)",
        "one weak (8)",
        "two dead (16)",
        "two stuck-open (16)",
        "two weak (28)",
        "two dead un(12)",
        "two stuck-open un(12)",
    ]
    assert {row.faults.time for row in found} == {0.0, (0.0, 15.0), (0.0, 25.0)}


def test_bounds_are_below_what_settles_and_rise_with_what_is_lost():
    network, setup = loaded(AGENT, "cpu")
    found = flown(network, setup, Conditions(faults=PAIRS), 32, 7, "cpu")
    least = bounds(setup, PAIRS, 32, 7)
    sound = bounds(setup, FaultConditions(), 32, 7)
    assert (least <= found.settled).all()
    assert (least >= sound - 1e-12).all()
    assert least.mean() > 1.02 * sound.mean()
    assert sound.min() > 3.0  # 2.95 m at 0.53 m/s^2, half of it braking, arriving at 0.33 m/s
    assert sound.max() < 6.0
