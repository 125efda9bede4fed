"""Random spacecraft and flights against their bounds, and a broken bound found out."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

from campaigns import bounds
from campaigns.bounds import Bounds, beaten, points, random_craft
from rans.errors import ConfigError
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft import Thruster
from rans.optimal.certificate import hull
from rans.optimal.certificate.goal_set import GoalSet
from rans.optimal.certificate.plane.dual import Relaxation
from rans.optimal.certificate.plane.lattice import Lattice
from tests.support.tiny_lattice import lopsided


@pytest.fixture
def rows(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, float]]:
    """What each flight made of its bounds, in the order of the seeds."""
    found: list[dict[str, float]] = []
    monkeypatch.setattr(bounds, "beaten", lambda seed: found.append(beaten(seed)) or found[-1])
    return found


@pytest.mark.slow
def test_no_random_flight_is_below_its_bounds(rows: list[dict[str, float]]) -> None:
    """Some are on them: what holds all its thrusters open from rest cannot be done sooner."""
    report = Bounds(40, seed=100).run()
    assert report.passed, [check.reason for check in report.checks]
    shares = [row["least time"] for row in rows if row]
    assert len(shares) > 20
    assert max(shares) == pytest.approx(1.0, abs=1e-6)


def test_a_bound_that_is_too_high_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """The cap that once forgot the thrusters that turn."""
    of = hull.Reach.of.__func__  # type: ignore[attr-defined]
    monkeypatch.setattr(
        hull.Reach,
        "of",
        lambda *given: replace(found := of(hull.Reach, *given), most=float(found.thrust.max())),
    )
    report = Bounds(10, seed=35).run()
    assert [check.passed for check in report.checks] == [True, False, True]
    assert "seeds [" in report.checks[1].reason


def test_a_lattice_is_as_large_as_planned() -> None:
    """The plan is what the certificate then builds; larger ones are left out, and counted."""
    rest = PlanarState(Vec2(0.0, 0.0), Heading(0.0), Vec2(0.0, 0.0), 0.0)
    lattice = Lattice(lopsided(), 0.2)
    loose = GoalSet()
    built = Relaxation(lattice, rest, rest, loose, 7, None)._after.size
    assert points(lopsided(), rest, rest, loose, 7) == built


@pytest.mark.slow
def test_a_lattice_too_large_is_left_out_and_counted(
    rows: list[dict[str, float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bounds, "_MOST_POINTS", 1000)
    report = Bounds(40, seed=100).run()
    assert report.passed
    reasons = {skipped.name: skipped.reason for skipped in report.skipped}
    assert len(rows) == 40
    large = sum("too large" in row for row in rows)
    assert int(reasons["certificates of large lattices"].split()[0]) == large > 0


def test_random_craft_are_of_every_kind() -> None:
    some = [random_craft(np.random.default_rng(seed)) for seed in range(80)]
    assert {craft.dimension for craft in some} == {2, 3}
    assert {craft.thrust_sharing for craft in some} == {"none", "split"}
    equal = [len({t.force for t in craft.thrusters}) == 1 for craft in some]
    assert 10 < sum(equal) < 70
    central = [
        any(np.allclose(np.cross(t.position, t.direction), 0.0) for t in craft.thrusters)
        for craft in some
    ]
    assert sum(central) > 20


def test_flights_that_need_nothing() -> None:
    assert bounds._share(0.0, 0.0) == 1.0
    assert bounds._share(0.1, 0.0) == np.inf
    assert bounds._share(1.0, 2.0) == 0.5
    assert any("dual of the certificate" in beaten(seed) for seed in range(30))


def test_what_no_flight_has_is_not_passed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a certificate there is no check of certificates, and a study of nothing is refused."""
    monkeypatch.setattr(bounds, "beaten", lambda _: {"least time": 0.5, "least impulse": 1.0})
    report = Bounds(3).run()
    assert [check.name for check in report.checks] == [
        "least time: flights below",
        "least impulse: flights below",
    ]
    assert [(s.name, s.reason) for s in report.skipped] == [
        ("dual of the certificate", "None of these flights has one.")
    ]
    with pytest.raises(ConfigError, match="--craft must be >= 1, got 0"):
        Bounds(0).run()


@pytest.mark.parametrize("share", [1.0 + 1e-8, np.inf, np.nan])
def test_the_command_names_what_flew_below_its_bound(
    share: float, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of seeds 5, 6 and 7 the second; a hundred-millionth is more than rounding."""
    monkeypatch.setattr(bounds, "beaten", lambda seed: {"least time": share if seed == 6 else 1.0})
    monkeypatch.setattr("sys.argv", ["bounds", "--craft", "3", "--seed", "5"])
    assert bounds.main() == 1
    shown = " ".join(capsys.readouterr().out.split())
    assert "least time: flights below: Of 3 flights" in shown
    assert "; seeds [6]." in shown
    assert shown.endswith("FAIL")
    monkeypatch.setattr(bounds, "beaten", lambda _: {"least time": 1.0 + 1e-10})
    assert bounds.main() == 0
    assert capsys.readouterr().out.rstrip().endswith("pass")


@pytest.mark.slow
def test_flights_that_spin_too_fast_to_be_exact_are_left_out() -> None:
    """In space from 3 rad/s on, of which eight steps a period are not exact; in the plane any step is."""
    fastest = {2: 0.0, 3: 0.0}
    lost = {2: 0, 3: 0}
    for seed in range(150):
        random = np.random.default_rng(seed)
        craft = random_craft(random)
        flown = bounds._flight(craft, random)
        if flown is None:
            lost[craft.dimension] += 1
        else:
            fastest[craft.dimension] = max(
                fastest[craft.dimension], float(np.linalg.norm(flown[1].spin()))
            )
    assert 1.5 < fastest[3] < 3.0 < fastest[2]
    assert lost[3] > 10 > lost[2] == 0


def test_thrust_time_by_the_velocity_it_gives() -> None:
    """One thruster of 2 N through the centre of 4 kg, not turning: what is gained is all it spent."""
    with warnings.catch_warnings(action="ignore"):  # that it cannot be steered does not matter
        craft = replace(lopsided(), thrusters=(Thruster((0.1, 0.0, 0.0), (1.0, 0.0, 0.0), 2.0),))
    gained = []
    for seed in range(20):
        flown = bounds._flight(craft, np.random.default_rng(seed))
        assert flown is not None
        start, end, spent, steps = flown
        if start.w == 0.0:
            gained.append(spent)
            assert 4.0 * float((end.v - start.v).norm()) == pytest.approx(spent)
            assert spent <= 2.0 * 0.2 * steps + 1e-12
    assert len(set(gained)) > 4
