"""What tasks, orbits, controllers, filters and bounds of missions refuse, with a sentence that says why."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from rans_missions.control.circumnavigation import Circumnavigation
from rans_missions.control.convex_guidance import ConvexGuidance
from rans_missions.control.corridor import Corridor
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.control.passive_approach import PassiveApproach
from rans_missions.guard import safety_filter
from rans_missions.guard.manoeuvres import check_throttles
from rans_missions.tasks import (
    Avoid,
    Dock,
    DockPort,
    FinalApproach,
    Hold,
    Inspect,
    Rendezvous,
    TargetOrbit,
)

from rans import LQR, ConfigError, GoToPose
from rans.effectors.motion import check_gradient
from rans.episode.flight import Setup
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.shapes import Ball

PLATFORM = load_spacecraft("floating-platform")
DEPUTY = load_spacecraft("afrl-deputy")
CHASER = load_spacecraft("vbar-chaser")
LANDER = load_spacecraft("mars-lander-steered")
ELLIPSE = TargetOrbit(eccentricity=0.5, semi_major_axis_km=13_556.0)
LOW = TargetOrbit(oblate=True, inclination_degrees=51.6)


class Gated(Rendezvous):
    """Has a limit that recommended velocities do not keep."""

    keeps = (Ball,)


TASKS: list[tuple[Callable[[], Any], str]] = [
    (lambda: Avoid(zones=17), "zones must be a whole number from 1 to 16, got 17"),
    (lambda: Avoid(zone_radius=(0.3, 1.0)), r"twice the largest zone_radius .*, 2\.8 m"),
    (lambda: DockPort(cone_half_angle=1.6), r"below 90 degrees, got 91\.6"),
    (lambda: DockPort(target_radius=0.7), r"below the standoff, 0\.65 m, got 0\.7"),
    (lambda: FinalApproach(position_tolerance=2.0), r"position_tolerance must be below 2\.0 m"),
    (lambda: Inspect(points=-1), "points must be a whole number"),
    (lambda: Inspect(keep_out=9.0), "inside the target"),
    (lambda: Inspect(view_degrees=120.0), "at most 90"),
    (lambda: Dock(deadline=(600.0, 3000.0)), r"deadline must be < 2906 s"),
    # Around the perigee half a turn takes less than half a period.
    (lambda: Dock(deadline=(600.0, 3000.0), orbit=ELLIPSE), r"deadline must be < 29\d\d s"),
    # The mission's mean motion of 0.001027 rad/s is that of 7,230 km.
    (lambda: Dock(orbit=TargetOrbit(0.3)), "50[56].*inside the Earth.*set semi_major_axis_km"),
    (lambda: Hold(orbit=TargetOrbit(0.1, 9000.0)), "Hold flies near circular orbits"),
]
ORBITS: list[tuple[Callable[[], Any], str]] = [
    (lambda: TargetOrbit(eccentricity=1.0), r"from 0 to 0\.9, got 1\.0"),
    (lambda: TargetOrbit(0.3, 7000.0), "4900 km from the Earth's centre, inside the Earth"),
    (lambda: TargetOrbit(0.3, -1.0), "semi_major_axis_km must be"),
    (lambda: TargetOrbit(true_anomaly_degrees=(90.0, 0.0)), "range .low, high."),
    (lambda: TargetOrbit(oblate=True, inclination_degrees=181.0), "from 0 to 180 degrees"),
    (lambda: TargetOrbit(inclination_degrees=51.6), "set oblate = true"),
    (lambda: TargetOrbit(target_drag=-1e-6), "target_drag must be .* >= 0"),
    (lambda: TargetOrbit(target_drag=3.7), r"at most 0\.01 m/s.2, got 3\.7"),
    (lambda: TargetOrbit(target_drag=4e-6), "set ballistic_ratio too"),
    (lambda: TargetOrbit(ballistic_ratio=0.0), r"ballistic_ratio must be .* above 0, got 0\.0"),
    (lambda: TargetOrbit(0.1, 9000.0, oblate=True), "eccentricity is 0.1: leave out one"),
    (lambda: TargetOrbit(oblate=True, gravity_gradient=True), "oblate"),
    (lambda: check_gradient(PLATFORM), "in the plane"),
]
CONTROLLERS: list[tuple[Callable[[], Any], str]] = [
    (lambda: LQR(DEPUTY, Dock(orbit=ELLIPSE)), "LQR .* changes along the orbit; fly a circular"),
    (lambda: LQR(CHASER, Hold(orbit=LOW)), "perturbed-orbit changes along the orbit"),
    (lambda: Circumnavigation(PLATFORM, GoToPose()), "inspections, and GoToPose is not one"),
    (lambda: Circumnavigation(DEPUTY, Inspect(view_degrees=60.0)), "must be 90, got 60"),
    (lambda: Corridor(PLATFORM, GoToPose()), "final approaches, and GoToPose is not one"),
    (
        lambda: PassiveApproach(PLATFORM, GoToPose()),
        "hold points, and GoToPose is not one: lqr flies most tasks, and rans train",
    ),
    (lambda: ConvexGuidance(PLATFORM, GoToPose()), "missions on an orbit"),
    (lambda: ConvexGuidance(DEPUTY, Dock(orbit=ELLIPSE)), "changes along the orbit"),
    (lambda: MissionGuidance(LANDER, Dock()), "one throttled or pulsed thruster either way"),
    (lambda: MissionGuidance("arpod-chaser", Gated()), "does not keep all limits of Gated"),
]
FILTERS: list[tuple[Callable[[], Any], str]] = [
    (lambda: safety_filter(Setup(PLATFORM, GoToPose())), "GoToPose has none"),
    (lambda: check_throttles(LANDER), "cannot be shut"),
    (lambda: check_throttles(load_spacecraft("cubesat-3u")), "opposite pairs"),
]


@pytest.mark.parametrize(("make", "sentence"), [*TASKS, *ORBITS, *CONTROLLERS, *FILTERS])
def test_what_cannot_be_is_refused(make, sentence):
    with pytest.raises(ConfigError, match=sentence):
        make()
