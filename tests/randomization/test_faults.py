"""Which faults are recoverable, against the faces of the set of wrenches and published counts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

import rans
from rans.randomization.faults import failed, fault_sets, margin

PLATFORM = rans.load_spacecraft("floating-platform")


@pytest.mark.parametrize(
    ("name", "singles", "pairs"),
    [("floating-platform", 8, 16), ("atmos", 8, 16), ("free-flyer", 16, 96)],
)
@pytest.mark.parametrize("kind", ["dead", "stuck-open"])
def test_as_many_as_were_counted_elsewhere(name, singles, pairs, kind):
    craft = rans.load_spacecraft(name)
    for count, expected in ((1, singles), (2, pairs)):
        assert sum(one.recoverable for one in fault_sets(craft, count, kind)) == expected


@pytest.mark.parametrize("lost", [(), (0,), (0, 1), (2, 3)])
@pytest.mark.parametrize("kind", ["dead", "stuck-open"])
def test_the_others_can_stay_as_far_from_shut_and_open_as_the_margin_says_and_no_farther(
    lost, kind
):
    craft = replace(
        PLATFORM,
        thrusters=tuple(
            replace(one, force=1.0 + 0.1 * k) for k, one in enumerate(PLATFORM.thrusters)
        ),
    )
    wrenches = np.array(craft.wrench_map)
    gain, leak = failed(kind, 1.0)
    sound = np.delete(wrenches, lost, axis=0)
    stuck = leak * wrenches[list(lost)].sum(axis=0)

    def stays(far):
        return linprog(
            np.zeros(len(sound)), A_eq=sound.T, b_eq=-stuck, bounds=(far, 1.0 - far)
        ).success

    found = margin(
        craft, lost, gain, leak
    )  # 1e-5: a hundred times what the programmes' conditions may lack
    assert found > 0.0
    assert stays(found - 1e-5)
    assert found > 0.499 or not stays(found + 1e-5)  # beyond one half the bounds cross


def test_a_weak_thruster_is_one_of_less_force_and_a_stuck_one_pushes_by_its_share():
    weak = replace(
        PLATFORM, thrusters=(replace(PLATFORM.thrusters[0], force=0.4), *PLATFORM.thrusters[1:])
    )
    assert margin(PLATFORM, (0,), *failed("weak", 0.4)) == pytest.approx(margin(weak, ()))
    found = list(fault_sets(PLATFORM, 2, "weak", (0.3, 1.0)))
    assert all(one.recoverable for one in found), "what gives any force can be used less"
    # Whoever pushes by a share is recoverable wherever dead and stuck open are: between the two.
    stuck = fault_sets(PLATFORM, 2, "stuck", (0.3, 1.0))
    ends = zip(fault_sets(PLATFORM, 2, "dead"), fault_sets(PLATFORM, 2, "stuck-open"), strict=True)
    assert [one.recoverable for one in stuck] == [a.recoverable and b.recoverable for a, b in ends]
