"""The campaign of assurances at a small size; what it counts is tested in packages/assurance/tests."""

from campaigns import assurances
from campaigns.assurances import _campaigns
from rans.episode.verdict import Failure


def test_who_is_flown_in_what():
    robust = "pretrained:go-to-pose-2d-robust"
    found = list(_campaigns(("go-to-pose-2d-robust", "multi-task-2d")))
    assert found[:2] == [(robust, "perfect"), (robust, "lab")]
    assert ("pretrained:multi-task-2d#track-twist", "perfect") in found
    assert len(found) == 2 + 5


def test_every_failure_has_a_word():
    assert assurances._SHORT.keys() == set(Failure)
