"""The campaigns: one row of data each, the table of robustness first. See `campaigns.runner.Campaign`.

``python -m campaigns NAME`` measures one; spaces of its name are written as dashes.
"""

from __future__ import annotations

from pathlib import Path

from campaigns.markdown import Table
from campaigns.runner import Campaign, Columns, Shown

_AGENTS = "pretrained:go-to-pose-2d-robust pretrained:go-to-pose-2d-faults pretrained:go-to-pose-2d"
_CRAFT = (
    "floating-platform",
    "floating-platform-air-tank",
    "floating-platform-shared",
    "free-flyer",
    "free-flyer-shared",
)
"""Spacecraft with a study of `rans validate`."""
_VALUES = "The values are in {file}."
_WON, _BROKEN = "{won:%.1f}", "{violated:%.1f}"
_FLOWN: Columns = (
    ("", "{condition}"),
    ("who", "{who}"),
    ("starts", "{starts:,}"),
    ("won, %", _WON),
    ("limit broken, %", _BROKEN),
    ("over the bound", "standings:over"),
    ("worst", "{worst:.3f}"),
)
"""Columns of a table with the flights of a mission beside their bounds."""
_UNSETTLED = ("starts", "worst")


def _mission(
    name: str,
    given: tuple[str, ...],
    quick: str,
    quick_seconds: float = 0.0,
    fewer_rows: bool = False,
) -> Campaign:
    """A mission's flights, whose rows say their number."""
    unit = "kg" if name == "land" else "N s"
    file = f"mission-{name}.json"
    return Campaign(
        tables={
            name.replace("-", " "): Shown(
                (*_FLOWN, ("spent", f"{{spent:~3}} {unit}")), source=_VALUES
            ),
            f"standings of {name}": standings(name),
        },
        page=f"missions/{name}.md",
        measure="missions:Missions",
        given=(name, *given),
        quick=(quick,),
        fewer_rows=fewer_rows,
        quick_seconds=quick_seconds,
        uncompared=_UNSETTLED,
        evidence=(file,),
    )


def standings(name: str) -> Shown:
    """The first table of a mission's page."""
    return Shown(
        rows=f"standings:rows {name}",
        page=f"missions/{name}.md",
        reads=(f"mission-{name}.json", "passive-safety.json", f"{name}-front.json"),
    )


def _front(when: str) -> Shown:
    """Impulse against time of a mission in the plane."""
    columns = (
        (when, "{time:g} s"),
        ("starts", "{solved} of {starts}"),
        ("proven bound", "{bound:.2f} N s"),
        ("optimal trajectory", "{flight:.2f} N s"),
        ("bound over it", "{mean:.2f} (≥ {least:.2f})"),
    )
    return Shown(columns, "front:means")


def _percent(*names: tuple[str, str]) -> Columns:
    """Columns of shares, by heading and field."""
    return tuple((heading, f"{{{name}:%.1f}}") for heading, name in names)


_NAMED: Columns = (
    ("", "{condition}"),
    ("errors", "{who}"),
    ("docked, %", _WON),
    *_FLOWN[4:],
    ("spent", "{spent:~3} N s"),
)
_QUANTITIES: Columns = (
    ("quantity", "{0}"),
    ("median error", "{1}"),
    ("95 % of errors below", "{2}"),
    ("intervals of 95 % that hold the truth", "{3}"),
)


_HELD = "{held[value]:.2f} ({held[low]:.2f} to {held[high]:.2f})"
_PERTURBED = Shown(
    (
        ("agent", "{agent}"),
        ("perturbation", "{row}"),
        ("solved, %", _HELD),
        ("settling, s", "{settling time:.1f}"),
        ("duty at rest, %", "{duty at rest:.1f}"),
    ),
    "batch:printed",
)
_FAULTY = Shown(
    (
        ("agent", "{agent}"),
        ("fault", "{row}"),
        ("solved, %", _HELD),
        ("settling, s", "{settling time:.1f}"),
        ("over its bound", "{over least:.2f}"),
        ("certified", "{over certified:.2f}"),
        ("lost, %", "{lost:.1f}"),
        ("distance, m", "{distance[0]:.2g}, {distance[1]:.2g}"),
        ("speed, m/s", "{speed[0]:.2g}, {speed[1]:.2g}"),
        ("spin, rad/s", "{spin[0]:.2g}, {spin[1]:.2g}"),
    ),
    "batch:printed",
)


def _errors_of(mission: str, margin: str) -> dict[str, Shown]:
    """Tables of the errors of a mission, and of what each adds."""
    flown = (
        ("error", "{error}"),
        ("won, %", _WON),
        ("limit broken, %", "{broken:%.1f}"),
        ("arrival, s", "{arrival}"),
        ("impulse, N s", "{impulse}"),
        (f"margin, {margin}", "{margin}"),
    )
    added = (
        ("error", "{error}"),
        ("impulse, mean", "{mean:%+.1f} %"),
        ("impulse, 99.7 %", "{spent:%+.1f} %"),
        ("arrival, 99.7 %", "{later}"),
        ("margin lost, 99.7 %", "{less:.2g}"),
        ("flights lost, %", "{lost:%.1f}"),
    )
    return {
        f"errors: {mission}": Shown(flown, f"error_sources:of_mission {mission}"),
        f"errors: sensitivity of {mission}": Shown(added, f"error_sources:costs {mission}"),
    }


CAMPAIGNS: dict[str, Campaign] = {
    "stress": Campaign(
        tables={"stress": Shown(rows="figures:stress", reads=("stress.json",))},
        page="assurance/stress.md",
        commands=(f"rans stress {_AGENTS} lqr switching --output runs/stress",),
        quick=("python -m campaigns.named_conditions --docs docs --episodes 64",),
        flights=(256, 64),
        shares=("go-to-pose", "lqr", "switching"),
        evidence=("stress.json",),
        moved=(("runs/stress/stress.json", "stress.json"),),
        quick_seconds=75.0,
    ),
    "validate": Campaign(
        tables={
            name: Shown(rows=f"figures:{name}", reads=tuple(f"{craft}.json" for craft in _CRAFT))
            for name in ("validations", "values")
        },
        page="validation.md",
        commands=tuple(f"rans validate {name} --output runs/{name}" for name in _CRAFT),
        quick=tuple(f"rans validate {name} --quick --output runs/{name}" for name in _CRAFT),
        fewer_rows=True,
        # Rounding errors differ by a factor; what counts is that each is below its tolerance.
        tolerance=(30.0, 100.0),
        uncompared=("time", "checks"),
        evidence=tuple(f"{name}.json" for name in _CRAFT),
        moved=tuple((f"runs/{name}/validation.json", f"{name}.json") for name in _CRAFT),
        quick_seconds=136.0,
    ),
    "judges": Campaign(
        tables={"judges": Shown(rows="figures:judges", reads=("judges.json",))},
        page="missions/judges.md",
        commands=("rans validate --judges --output runs/judges",),
        # Differences of the last digits differ by a factor with the processor.
        tolerance=(30.0, 100.0),
        evidence=("judges.json",),
        moved=(("runs/judges/judges.json", "judges.json"),),
        quick_seconds=20.0,
    ),
    "robustness": Campaign(
        tables={
            "robustness": Shown(
                rows="robustness:in_document", reads=("robustness.json", "robustness-space.json")
            )
        },
        page="assurance/robustness.md",
        prints={"solved, %": _PERTURBED},
        measure="robustness:Robustness",
        given=("pretrained:go-to-pose-2d-robust", "--episodes", "2000"),
        commands=(
            "python -m campaigns robustness --docs docs",
            "python -m campaigns robustness-in-space --docs docs",
        ),
        quick=(
            "python -m campaigns robustness --docs docs --episodes 200",
            "python -m campaigns robustness-in-space --docs docs --episodes 100",
        ),
        flights=(1000, 100),
        shares=("solved",),
        evidence=("robustness.json", "robustness-space.json"),
        quick_seconds=81.0,
    ),
    "robustness in space": Campaign(
        tables={},
        page="assurance/robustness.md",
        prints={"solved, %": _PERTURBED},
        measure="robustness:Robustness",
        given=("pretrained:go-to-pose-3d-robust", "--episodes", "1000"),
        evidence=("robustness-space.json",),
    ),
    "faults": Campaign(
        tables={
            "faults": Shown(rows="faults:in_document", reads=("faults.json", "faults-space.json"))
        },
        page="assurance/robustness.md",
        prints={"solved, %": _FAULTY},
        measure="faults:Faults",
        given=(
            "pretrained:go-to-pose-2d-faults",
            *("--episodes", "2000", "--bounded", "100", "--certified", "64"),
        ),
        commands=(
            "python -m campaigns faults --docs docs",
            "python -m campaigns faults-in-space --docs docs",
        ),
        quick=(
            "python -m campaigns faults --docs docs --episodes 100 --bounded 2 --certified 1",
            "python -m campaigns faults-in-space --docs docs --episodes 100 --bounded 2",
        ),
        flights=(2000, 100),
        shares=("start", "by 15 s", "moment"),
        # A single certified start costs up to half as much again as the mean of many.
        tolerance=(0.02, 0.5),
        evidence=("faults.json", "faults-space.json"),
        deterministic=False,
        quick_seconds=95.0,
    ),
    "faults in space": Campaign(
        tables={},
        page="assurance/robustness.md",
        prints={"solved, %": _FAULTY},
        measure="faults:Faults",
        given=("pretrained:go-to-pose-3d-faults", "--episodes", "2000", "--bounded", "400"),
        evidence=("faults-space.json",),
    ),
    "rest": Campaign(
        tables={
            "rest": Shown(
                (
                    ("agent", "`{agent}`"),
                    ("duty at rest, %", "{duty:.2f}"),
                    ("valve changes a second", "{changes:.2f}"),
                    ("steps with opposite nozzles open, %", "{opposite:.2f}"),
                    ("episodes that end in a cycle, %", "{cycles:.3g}"),
                ),
                "rest:cells",
                source=_VALUES,
            )
        },
        page="agents.md",
        measure="rest:Rest",
        quick=(
            "pretrained:go-to-pose-2d pretrained:go-to-pose-3d pretrained:track-velocity-2d --episodes 256",
        ),
        fewer_rows=True,
        flights=(16384, 256),
        uncompared=("in a cycle", "opposite"),
        evidence=("rest.json",),
        quick_seconds=9.0,
    ),
    "assurances": Campaign(
        tables={
            "assurances": Shown(
                rows="assurances:in_document",
                reads=("assurance",),
                source="Everything about each is in [validation/assurance](../../../docs/validation/assurance). "
                "Earlier weights: the agent was trained anew after it had been assured.",
            )
        },
        page="assurance/assurances.md",
        commands=("python -m campaigns.assurances",),
        quick=(
            "python -m campaigns.assurances go-to-pose-2d go-to-pose-2d-robust --flights 2048 --no-replay",
        ),
        fewer_rows=True,
        uncompared=("flights", "failed", "probability", "how they fail", "flown again"),
        evidence=("assurance",),
        quick_seconds=15.0,
    ),
    "craft": Campaign(
        tables={
            "craft": Shown(
                (
                    ("spacecraft", "`{name}`"),
                    ("mass, kg", "{mass}"),
                    ("force, N", "{force}"),
                    ("torque, N m", "{torque}"),
                    ("m/s²", "{m/s²}"),
                    ("rad/s²", "{rad/s²}"),
                    (
                        "dead, stuck open",
                        "{bearable[dead]} and {bearable[stuck-open]} of {thrusters}",
                    ),
                ),
                "craft:authority",
            ),
            "agents of craft": Shown(
                (
                    ("agent", "`{agent}`"),
                    ("period, flight", "{period:g} s, {seconds:g} s"),
                    ("starts", "{distance[0]:g} to {distance[1]:g} m"),
                    ("settled", "{settled[0]:.1f} % (≥ {settled[1]:.1f})"),
                    ("median time", "{settling time:.1f} s"),
                    ("no sooner than", "{bound:.1f} s"),
                    ("errors", "{position error:.2f} cm, {attitude error:.2f}°"),
                    ("in Drake", "{there}"),
                ),
                "craft:agent_cells",
            ),
        },
        page="any_craft/craft.md",
        measure="craft:Craft",
        labels=("name",),
        quick=("pingu spheres --drake 2 --episodes 256",),
        fewer_rows=True,
        flights=(1024, 256),
        uncompared=("in Drake",),
        evidence=("craft.json",),
        deterministic=False,
        quick_seconds=22.0,
    ),
    "craft rivals": Campaign(
        tables={
            "controllers of craft": Shown(
                (
                    ("spacecraft", "`{name}`"),
                    ("flights", "{episodes}"),
                    ("settled, %: agent, lqr, switching", "{settled}"),
                    ("median time, s", "{time}"),
                    ("impulse, N s", "{impulse}"),
                ),
                "craft_rivals:cells",
            )
        },
        page="any_craft/craft.md",
        measure="craft_rivals:Rivals",
        labels=("name",),
        quick=("pingu spheres --episodes 8",),
        fewer_rows=True,
        flights=(16, 8),
        uncompared=("flights",),
        evidence=("craft_rivals.json",),
        quick_seconds=45.0,
    ),
    "craft bounds": Campaign(
        tables={
            "bounds of craft": Shown(
                (
                    ("spacecraft", "`{name}`"),
                    ("starts", "{starts}"),
                    ("least time: bound, best flight", "{time}"),
                    ("hull bound over best", "{hull}"),
                    ("tube bound over best", "{tube}"),
                    ("least impulse: bound, best flight", "{impulse}"),
                    ("tube bound over best (impulse)", "{tube impulse}"),
                ),
                "craft_bounds:cells",
            )
        },
        page="certificate.md",
        measure="craft_bounds:CraftBounds",
        labels=("name",),
        quick=("freeflyer2 --starts 1",),
        fewer_rows=True,
        named_by=1,
        uncompared=("starts",),
        evidence=("craft-bounds.json",),
        quick_seconds=10.0,
    ),
    "avoid": _mission("avoid", (), "--episodes 64 --bounded 4", 55.0),
    "impulse among zones": Campaign(
        tables={"impulse among zones": _front("at the goal by")},
        page="missions/avoid.md",
        measure="front:Front",
        given=("avoid", "--times", "8", "12", "20.2"),
        quick=("--times 20.2",),
        fewer_rows=True,
        evidence=("avoid-front.json",),
        quick_seconds=35.0,
    ),
    "impulse to the port": Campaign(
        tables={"impulse to the port": _front("docks at")},
        page="missions/dock-port.md",
        measure="front:Front",
        given=("dock-port", "--times", "14", "20", "30"),
        quick=("--times 14",),
        fewer_rows=True,
        evidence=("dock-port-front.json",),
        quick_seconds=48.0,
    ),
    "dock port": _mission("dock-port", (), "--episodes 64", 130.0),
    "dock": _mission(
        "dock",
        ("--episodes", "10000"),
        "--episodes 64 --bounded 1 --deadlines 1000",
        fewer_rows=True,
        quick_seconds=26.0,
    ),
    "hold": _mission(
        "hold",
        ("--bounded", "16"),
        "--episodes 4 --bounded 1 --deadlines 600",
        fewer_rows=True,
        quick_seconds=63.0,
    ),
    "rendezvous": _mission(
        "rendezvous",
        ("--episodes", "256"),
        "--episodes 8 --bounded 1 --deadlines 4000",
        fewer_rows=True,
        quick_seconds=84.0,
    ),
    "land": _mission(
        "land", ("--drake", "8"), "--episodes 16 --bounded 2 --drake 1", quick_seconds=104.0
    ),
    "dock with errors": Campaign(
        tables={
            "dock with errors": Shown(
                _NAMED,
                source=f"Each row has {{episodes:,}} starts; bounds are those of the first {{bounded}}. {_VALUES}",
            )
        },
        page="missions/dock.md",
        measure="error_sources:DockErrors",
        quick=("--episodes 48 --bounded 4",),
        flights=(1024, 48),
        uncompared=("worst",),
        evidence=("dock-errors.json",),
        quick_seconds=99.0,
    ),
    "dock on ellipses": Campaign(
        tables={
            "dock on ellipses": Shown(
                (
                    ("eccentricity", "{condition}"),
                    ("who", "{who}"),
                    ("starts", "{starts:,}"),
                    ("docked, %", _WON),
                    ("limit broken, %", _BROKEN),
                    ("over the bound", "standings:over"),
                    ("spent", "{spent:~3} N s"),
                    ("median time, s", "{median:,.0f}"),
                ),
                source=f"The deadline is 1,000 s. {_VALUES}",
            ),
            "coasts on ellipses": Shown(
                (
                    ("eccentricity", "{eccentricity:g}"),
                    ("Clohessy-Wiltshire, m", "{circle[0]:~2}"),
                    ("largest, m", "{circle[1]:~2}"),
                    ("ellipse, m", "{ellipse[0]:~2}"),
                    ("largest, m", "{ellipse[1]:~2}"),
                ),
                "errors",
                source="{coasts:,} coasts of 1,000 s from 150 m, median and largest error.",
            ),
        },
        page="missions/elliptic.md",
        measure="elliptic:Elliptic",
        labels=("condition", "who"),
        quick=("--episodes 16 --bounded 1",),
        flights=(64, 16),
        uncompared=("starts", "over the bound", "median time, s"),
        evidence=("elliptic.json",),
        quick_seconds=127.0,
    ),
    "hold with J2 and drag": Campaign(
        tables={
            "hold with J2 and drag": Shown(
                (
                    ("who", "{who}"),
                    ("flown in", "{flown in}"),
                    ("starts", "{starts:,}"),
                    ("won, %", "{won:.1f}"),
                    ("limit broken, %", "{broken:.1f}"),
                    ("mean spent, N s", "{spent:.0f}"),
                    ("over the sphere, %", "{more:+.1f}"),
                    ("worst, %", "{worst:+.1f}"),
                ),
                source=f"The deadline is 1,000 s. {_VALUES}",
            ),
            "what is known with J2 and drag": Shown(
                (
                    ("", "{what}"),
                    ("who", "{who}"),
                    ("starts", "{starts}"),
                    ("won, %", "{won}"),
                    ("over the bound", "{ratio}"),
                    ("mean spent, N s", "{spent}"),
                ),
                "perturbed:known",
            ),
            "coasts with J2 and drag": Shown(
                (
                    ("distance, m", "{distance:,.0f}"),
                    ("coasts", "{coasts}"),
                    (
                        "these equations: median, worst error, m",
                        "{these equations[0]:.2f}, {these equations[1]:.2f}",
                    ),
                    ("a circle: median, worst error, m", "{circle[0]:.2f}, {circle[1]:.2f}"),
                ),
                "coasts",
            ),
        },
        page="missions/perturbed.md",
        measure="perturbed:Perturbed",
        quick=("--episodes 4 --true 1",),
        flights=(64, 4),
        uncompared=("starts", "mean spent, N s", "over the sphere, %", "worst, %"),
        evidence=("perturbed.json",),
        quick_seconds=170.0,
    ),
    "error sources": Campaign(
        tables={
            **_errors_of("dock", "m/s"),
            **_errors_of("hold", "m"),
            "errors: linear": Shown(
                (
                    ("error", "{error}"),
                    ("position, linear", "{position[0]:.3g} cm"),
                    ("flights", "{position[1]:.3g} cm"),
                    ("ratio", "{position[2]:.3f}"),
                    ("velocity, linear", "{velocity[0]:.3g} mm/s"),
                    ("flights", "{velocity[1]:.3g} mm/s"),
                    ("ratio", "{velocity[2]:.3f}"),
                ),
                "error_sources:linear",
                source=_VALUES,
            ),
        },
        page="missions/errors.md",
        measure="error_sources:ErrorSources",
        labels=("mission", "error"),
        quick=("--episodes 48 --flights 256",),
        flights=(512, 48),
        tolerance=(0.05, 0.5),
        evidence=("error-sources.json",),
        quick_seconds=302.0,
    ),
    "slosh": Campaign(
        tables={
            "slosh": Shown(
                (
                    ("who", "{who}"),
                    ("swings, % of the mass", "{share:%g}"),
                    ("settled or docked, %", _WON),
                    ("limit broken, %", _BROKEN),
                    ("median time, s", "{time:,.1f}"),
                    ("impulse, N s", "{impulse:,.1f}"),
                    ("first starts, %", "{drake_here:%,.1f}"),
                    ("in Drake, %", "{drake:%,.1f}"),
                ),
                source="{rows[0][starts]:,} starts each. The first {rows[3][drake_starts]} fly in Drake too. "
                f"{_VALUES}",
            )
        },
        page="missions/slosh.md",
        measure="slosh:Sloshing",
        quick=("--episodes 64 --drake 4",),
        flights=(256, 64),
        uncompared=("first starts, %", "in Drake, %"),
        evidence=("slosh.json",),
        quick_seconds=155.0,
    ),
    "docking with contact": Campaign(
        tables={
            "docking with contact": Shown(
                (
                    ("agent", "{agent}"),
                    ("port", "{port}"),
                    *_percent(
                        ("docked, %", "docked"),
                        ("docked with contact, %", "with_contact"),
                        ("captured, %", "captured"),
                        ("touched before, %", "touched"),
                        ("at most, cm/s", "contact_speed"),
                    ),
                    ("contact at most, N", "{contact_force:.1f}"),
                    ("latches at most, N", "{latch_load:.1f}"),
                ),
                source=f"{{episodes:,}} starts each. {_VALUES}",
            )
        },
        page="missions/dock-port.md",
        measure="dock_contact:DockContact",
        quick=("--episodes 2",),
        flights=(64, 2),
        uncompared=("at most",),
        evidence=("dock-contact.json",),
        quick_seconds=69.0,
    ),
    "safe states": Campaign(
        tables={
            "safe states": Shown(
                (
                    ("", "{mission}"),
                    ("towards the zone", "{speed:g} m/s"),
                    *_percent(
                        *(
                            (f"{distance} m", f"safe[{k}]")
                            for k, distance in enumerate(("0.05", "0.1", "0.2", "0.4", "0.8"))
                        )
                    ),
                ),
                source=f"{{states:,}} states each, in %. {_VALUES}",
            )
        },
        page="missions/guard.md",
        measure="safe_set:SafeSet",
        quick=("--states 128",),
        flights=(500, 60),  # about half of the states lie within another zone
        shares=(" m",),
        evidence=("safe-set.json",),
        seconds=7.0,
        quick_seconds=5.0,
    ),
    "identification": Campaign(
        tables={"identification": Shown(_QUANTITIES, source=_VALUES)},
        page="robot/identify.md",
        measure="identification:Hidden",
        quick=("--count 12",),
        flights=(256, 12),
        tolerance=(0.02, 1.0),
        uncompared=("95 % of errors below",),
        evidence=("identification.json",),
        quick_seconds=37.0,
    ),
    "identification in space": Campaign(
        tables={"identification in space": Shown(_QUANTITIES, source=_VALUES)},
        page="robot/identify.md",
        measure="identification:Hidden",
        given=("--spacecraft", "cubesat-6u", "--period", "0.5"),
        quick=("--count 4",),
        flights=(256, 4),
        tolerance=(0.02, 1.0),
        uncompared=("95 % of errors below",),
        evidence=("identification-space.json",),
        quick_seconds=90.0,
    ),
    "identification of satellites": Campaign(
        tables={
            "identification of satellites": Shown(
                _QUANTITIES, source=f"{{refused}} of {{count}} logs were refused. {_VALUES}"
            )
        },
        page="robot/identify.md",
        measure="satellites:HiddenSatellites",
        quick=("--count 6",),
        flights=(64, 6),
        tolerance=(0.02, 1.0),
        uncompared=("95 % of errors below",),
        evidence=("identification-satellites.json",),
        quick_seconds=40.0,
    ),
    "inspect": Campaign(
        tables={
            "inspect": Shown(
                (
                    ("who", "{who}"),
                    ("succeeded, %", "{succeeded:%.1f}"),
                    ("limit broken, %", "{broken:%.1f}"),
                    ("time, median (worst), s", "{median:,.0f} ({slowest:,.0f})"),
                    ("impulse, mean (worst), N s", "{impulse:.2f} ({worst:.2f})"),
                    ("bound, N s", "{bound:.2f}"),
                ),
                source="{episodes:,} starts each. The bound is the mean of the least impulse of success in the "
                f"time of the same flight. {_VALUES}",
            ),
            "standings of inspect": standings("inspect"),
        },
        page="missions/inspect.md",
        measure="inspection:Inspection",
        labels=("who",),
        # The cheapest of all, so that the standings name it too.
        quick=('--episodes 2 --only "circumnavigation, 12,240 s"',),
        fewer_rows=True,
        flights=(64, 2),
        tolerance=(0.02, 0.6),
        uncompared=("starts",),
        evidence=("mission-inspect.json",),
        quick_seconds=31.0,
    ),
    "passive safety": Campaign(
        tables={
            "passive safety": Shown(
                (
                    ("guidance", "{who}"),
                    ("starts", "{starts:,}"),
                    ("won, %", _WON),
                    ("unsafe flights, %", "{unsafe:%.1f}"),
                    ("unsafe starts, %", "{unsafe_start:%.1f}"),
                    ("zone, m", "passive:zone"),
                    ("least coast distance, m", "{least:.1f}"),
                    ("impulse, N s", "{impulse:.3g}"),
                ),
                source=_VALUES,
            ),
            "percentiles": Shown(
                (
                    ("guidance", "{who}"),
                    ("quantity", "{quantity}"),
                    *(
                        (f"{x} %", f"{{values[{k}]}}")
                        for k, x in enumerate(("50", "90", "99", "99.7"))
                    ),
                ),
                "passive:percentiles",
            ),
        },
        page="missions/passive_safety.md",
        measure="passive:Passive",
        labels=("who",),
        quick=('--episodes 64 --only "dock, mission"',),
        fewer_rows=True,
        uncompared=("starts", "least", "90 %", "99 %", "99.7 %"),
        evidence=("passive-safety.json",),
        quick_seconds=7.0,
    ),
    "published optima": Campaign(
        tables={
            "published optima": Shown(
                (
                    ("problem", "{problem}"),
                    ("published", "{published:.4f} {unit}"),
                    ("RANS", "{cost:.4f}"),
                    ("difference, %", "published_optima:difference"),
                    ("guesses", "{agreeing} of {guesses}"),
                    ("optima", "{optima}"),
                    ("source", "{source}"),
                ),
                source="Guesses: those that led to this cost, of all; optima: different costs that they led to. "
                f"{_VALUES}",
            )
        },
        page="optimal.md",
        measure="published_optima:PublishedOptima",
        tolerance=(0.001, 0.001),
        uncompared=("guesses", "optima"),
        evidence=("published-optima.json",),
        seconds=15.0,
    ),
    "throttling": Campaign(
        tables={
            "throttling": Shown(
                (
                    ("engines", "{engines}"),
                    ("starts", "{starts}"),
                    ("with a landing, throttled alike", "{landings alike}"),
                    ("one by one", "{landings apart}"),
                    ("least propellant, alike", "{alike:.1f} kg"),
                    ("one by one, at least", "{apart:.1f} kg"),
                    ("other starts, at least", "{others}"),
                ),
                "throttling:shown",
                source=_VALUES,
            )
        },
        page="missions/land.md",
        measure="throttling:Throttling",
        quick=("--episodes 3",),
        uncompared=("starts", "with a landing", "one by one", "other starts"),
        evidence=("throttling.json",),
        quick_seconds=54.0,
    ),
    "agents": Campaign(
        tables={
            "agents": Shown(
                (
                    ("task, protocol", "{row}"),
                    *(
                        (name, f"{{{name}}}")
                        for name in ("what", "original", "target", "ours", "verdict", "command")
                    ),
                ),
                "agents:cells",
                source="The values of every training are in {file}.",
            )
        },
        page="agents.md",
        measure="agents:Agents",
        given=("runs/agents",),
        flights=(1024, 1024),
        evidence=("agents.json",),
        needs="runs/agents, three trainings of each row (docs/agents.md)",
    ),
    "V-BAR": Campaign(
        tables={
            "V-BAR": Shown(
                (
                    ("scenario", "{scenario}"),
                    ("episodes", "{episodes}"),
                    ("succeeded", "{rans[succeeded]}"),
                    ("limits broken", "{rans[broken]}"),
                    ("composite", "{rans[composite]:.3f}"),
                    ("spent, m/s", "{rans[spent]:.2f}"),
                    ("worst", "{rans[worst]:.2f}"),
                    ("time, s", "{rans[time]:,.0f}"),
                    ("soft limits broken", "{soft}"),
                    ("network", "{agent}"),
                    ("V-BAR's PD", "{peer}"),
                ),
                "vbar:cells",
                source=_VALUES,
            )
        },
        page="missions/vbar.md",
        measure="vbar:Scored",
        labels=("scenario",),
        evidence=("vbar.json",),
        needs="vbar, an environment with Python 3.12 and V-BAR (docs/missions/vbar.md)",
    ),
    "exports": Campaign(
        tables={},
        page="export.md",
        prints={
            "exports": Shown(
                (
                    ("agent", "{agent}"),
                    ("form", "{form}"),
                    ("observations", "{observations:,}"),
                    ("other commands", "{unequal}"),
                    ("beyond rounding", "{beyond_rounding}"),
                    ("memory", "{memory:.1e}"),
                )
            )
        },
        measure="exports:Exports",
        labels=("agent", "form"),
        evidence=("exports.json",),
    ),
    "guard": Campaign(
        tables={},
        page="missions/guard.md",
        prints={
            "safety filter": Shown(
                (
                    ("mission", "{mission}"),
                    ("who", "{who}"),
                    ("flights", "{flights:,}"),
                    ("violated", "{violated:,}"),
                    ("least margin", "{least:.4f}"),
                    ("starts outside the filter's set, violated", "{unsafe}, {violated_unsafe}"),
                    ("interventions, %", "{interventions:%.2f}"),
                    ("reached, %", "{reached:%.2f}"),
                    ("after, s", "{settled:.1f}"),
                    ("impulse, N s", "{impulse:.2f}"),
                    ("steps/s", "{rate:,.0f}"),
                )
            )
        },
        measure="guard:Guarded",
    ),
}
"""By what is measured, the table of robustness first; the last ones have no table that is flown again."""
ROWS = {name: campaign for name, campaign in CAMPAIGNS.items() if campaign.tables}
"""Campaigns whose tables stand on pages, which `rans reproduce` flies again, by name."""
PAGES = {name: campaign for campaign in CAMPAIGNS.values() for name in campaign.tables}
"""Campaigns by the names of their tables."""


def table(docs: Path, name: str) -> Table:
    """Table of this name, of the evidence in docs/validation."""
    return PAGES[name].table(docs, name)
