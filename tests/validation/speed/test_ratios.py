from __future__ import annotations

from validation.peers.runner import PeerResult
from validation.speed.measurement import Measurement
from validation.speed.ratios import bounds, over_trainer, until_solved
from validation.speed.training import Success


def test_shares_of_bounds() -> None:
    rows = [Measurement("engine", "a", 3.0, "M", bound=4.0, bound_name="b"),
            Measurement("engine", "c", 3.0, "M"), Measurement("policy", "d", None, "us", bound=1.0)]
    assert [(r.name, r.value) for r in bounds(rows)] == [("a: share of b", 0.75)]


def test_ratios_over_a_trainer() -> None:
    figures = {"trained_steps_per_s": 2e4, "solved": False, "seconds_to_success": 300.0,
               "steps_to_success": 10}
    peer = PeerResult("sb3", "command", figures=figures)
    assert over_trainer(peer, 1e5, "cpu").value == 5.0
    assert "100 or more" in over_trainer(peer, 1e5, "cuda:0").note
    ratio = until_solved(peer, Success(True, seconds=15.0, warm_up=0.0, steps=4))
    assert ratio.value == 20.0
    assert "lower bound" in ratio.note


def test_ratios_by_hand() -> None:
    measured = [Measurement("engine", "x", 50.0, "M steps/s", bound=200.0, bound_name="y"),
                Measurement("engine", "z", None, "M", bound=1.0), Measurement("engine", "w", 1.0, "M")]
    share, = bounds(measured)
    assert (share.name, share.value, share.note) == ("x: share of y", 0.25, "50 of 200 M steps/s")
    peer = PeerResult("other", "command", figures={
        "trained_steps_per_s": 2e4, "seconds_to_success": 90.0, "solved": False, "steps_to_success": 10**6})
    faster = over_trainer(peer, 1e6, "cpu")
    assert (faster.value, "5 or more" in faster.note) == (50.0, True)
    sooner = until_solved(peer, Success(True, 3.0, 1.0, 2000))
    assert sooner.value == 30.0
    assert "the ratio is a lower bound" in sooner.note
