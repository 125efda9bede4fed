"""What a verdict is about: every range of conditions, and requirement, length and starts by hand."""

from dataclasses import replace

from rans_assurance.scope import conditions_texts, scope

import rans
from rans import BodyConditions, Conditions, GoToPose, Timing
from rans.episode.scenario import scenarios
from rans.episode.step import Setup


def test_each_part_of_a_mixture_has_its_share():
    light = Conditions(BodyConditions(mass=0.5, inertia=1.5), weight=3.0)
    mixture = replace(Conditions(BodyConditions(mass=2.0, inertia=1.5)), others=(light,))
    assert [*conditions_texts(mixture)] == [
        "in 25 % of the flights: body.mass 2; body.inertia 1.5",
        "in 75 % of the flights: body.mass 0.5; body.inertia 1.5",
    ]
    assert [*conditions_texts(Conditions())] == ["nominal conditions"]


def test_requirement_length_and_starts_by_hand():
    """188 periods of 0.2 s are 37.6 s; the last fifth are 37 instants, of which the first is number 152, 30.4 s."""
    craft = rans.load_spacecraft("floating-platform")
    task = GoToPose(position_tolerance=0.07).for_evaluation()
    setup = Setup(craft, task, Timing(episode_steps=188))
    stated = scope(setup, scenarios(task, craft, 2026, 1000))
    said = dict(stated)
    for text in ("position within 7 cm", "attitude within 5 deg", "from 30.4 s on"):
        assert text in said["requirement"]
    # Of 1,000 distances between 3 and 4 m the ends are nearer than 0.5 cm to these with a chance of 99.3 % each.
    assert "position error 3 to 4 m" in said["starts"]
    assert "speed 0 m/s" in said["starts"]
    assert ("length of a flight", "37.6 s: 188 control periods of 0.2 s") in stated
    assert (
        "a flight also fails",
        "distance from the goal beyond which an episode fails, m: 8",
    ) in stated
