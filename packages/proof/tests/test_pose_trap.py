"""Trapping sets of poses: flights, the checker's sets against simulated states, and planted errors."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

pytest.importorskip("flint")

from rans_proof import check_late, check_pose
from rans_proof.agent_reader import AgentWeights, read_agent
from rans_proof.balls import Refused
from rans_proof.pages import proof_entry, proof_section
from rans_proof.pose_flights import check_pose_as_flown, leaving, read_run
from rans_proof.verdicts import FILES

from rans.cli import main
from rans.extend import Section

from .planted import ERRORS, Change, forge, planted_in

MASS, INERTIA, PERIOD = 5.32, 0.2045008, 0.1


@pytest.fixture
def table(certificate: bytes) -> dict[str, Any]:
    return json.loads(certificate)


def judged(table: dict[str, Any], files: dict[str, bytes]) -> check_pose.PoseCertificate:
    return check_pose.check_pose(json.dumps(table).encode(), files)


def test_it_is_accepted_and_no_flight_leaves(certificate: bytes, files: dict[str, bytes]) -> None:
    assert check_pose.check_pose(certificate, files).settled == 0.0
    left, far, turned = leaving(read_run(files), json.loads(certificate), 2000, 40, 3)
    assert left == 0
    assert far < 0.05
    assert turned < math.radians(5.0)


def without(table: dict[str, Any], part: str) -> None:
    """The last row's runs, which flights come to, are gone."""
    rows = table["cells"][part]
    rows[:] = [run for run in rows if run[0] != max(run[0] for run in rows)]


CHANGED: dict[str, Change] = {
    "a row of positions": lambda t: without(t, "place"),
    "a row of headings": lambda t: without(t, "heading"),
    "a smaller limit": ("keep.position", 0.03),
    "a smaller heading": ("keep.heading", 1.5),
    "farther starts": ("start.position", 0.03),
    "faster starts": ("start.speed", 0.1),
    "faster spins": ("start.spin", 0.5),
    "wider errors of mass": ("uncertainty.mass", 0.1),
    "wider errors of thrust": ("uncertainty.thrust", 0.1),
    "wider readings": ("uncertainty.position", 0.01),
    "wider readings of velocity": ("uncertainty.velocity", 0.01),
    "wider readings of the heading": ("uncertainty.heading", 0.02),
    "wider readings of the spin": ("uncertainty.spin", 0.05),
    "later to open": ("uncertainty.opening", 0.004),
    "later to shut": ("uncertainty.shutting", 0.004),
    "a little later to open and to shut": lambda t: t["uncertainty"].update(
        opening=0.0008, shutting=0.0008
    ),
    "later than a period": ("uncertainty.shutting", 0.11),
    "no delays": lambda t: t["uncertainty"].pop("opening"),
    "smaller cells": ("grid.speed", 0.0039),
    "other cells of spin": ("grid.spin", 0.0041),
    "another agent": lambda t: t["agent"].update({FILES[0]: "0" * 64}),
    "a key that nobody reads": ("note", "checked"),
    "a start without a number": ("start.position", math.nan),
    "an empty run": lambda t: t["cells"]["place"].append([0, 3, 3]),
    "too few sectors": ("reach", {"sectors": 0, "periods": 5}),
    "moving starts of a way": ("reach", {"sectors": 1, "periods": 5}),
}  # fmt: skip


@pytest.mark.parametrize("changed", CHANGED)
def test_another_claim_is_refused(
    changed: str, table: dict[str, Any], files: dict[str, bytes]
) -> None:
    forge(table, CHANGED[changed])
    with pytest.raises(Refused):
        judged(table, files)


@pytest.mark.parametrize(
    ("old", "new"),
    [(b"mass = 5.32", b"mass = 1e-3"), (b"inertia = 0.2045008", b"inertia = 1e-4")],
)
def test_thrust_whose_rounding_would_count_is_refused(
    old: bytes, new: bytes, table: dict[str, Any], files: dict[str, bytes]
) -> None:
    """Numbers in SI units are widened by 1e-9."""
    content = files["spacecraft.toml"].replace(old, new, 1)
    table["agent"]["spacecraft.toml"] = hashlib.sha256(content).hexdigest()
    with pytest.raises(Refused, match="too strong for double"):
        judged(table, files | {"spacecraft.toml": content})


def test_cells_whose_rounding_would_count_are_refused(
    table: dict[str, Any], files: dict[str, bytes]
) -> None:
    table["grid"]["spin"] = 180.0
    with pytest.raises(Refused, match="too fast for double"):
        judged(table, files)


STEEP: dict[str, Callable[[AgentWeights], AgentWeights]] = {
    "of units": lambda a: a._replace(layers=[a.layers[0], (1e3 * a.layers[1][0], a.layers[1][1])]),
    "of scores": lambda a: a._replace(head=(1e3 * a.head[0], a.head[1])),
    "that cancel in a bias": lambda a: a._replace(
        layers=[(a.layers[0][0] - 3e38 * FLAG, a.layers[0][1] + 3e38), a.layers[1]]
    ),
    "that cancel between scores": lambda a: a._replace(head=(a.head[0], a.head[1] + 3e38)),
}  # fmt: skip
FLAG = np.eye(8)[3]
"""The column that is always 1."""


@pytest.mark.parametrize("sums", STEEP)
def test_sums_that_single_precision_cannot_hold_are_refused(
    sums: str, files: dict[str, bytes]
) -> None:
    """Log-odds are widened by a thousandth; those of the agent are below 10^7."""
    agent = read_agent(files["agent.safetensors"], 8)
    check_pose.Network(agent)
    with pytest.raises(Refused, match="too steep for single"):
        check_pose.Network(STEEP[sums](agent))


def test_a_column_that_is_clipped_is_refused(
    table: dict[str, Any], files: dict[str, bytes]
) -> None:
    """Positions to 5 cm are clipped at 10 after a scale of 1000, which the first layer would undo."""
    agent = read_agent(files["agent.safetensors"], 8)
    loop = check_pose.Loop(table, files)
    place, heading = (loop.cells(table["cells"][name], name) for name in ("place", "heading"))
    loop.check_closed(place, heading, loop.bounds(place, heading))
    variance = agent.variance.copy()
    variance[4:6] = 0.0
    weight, bias = agent.layers[0]
    layers = [(weight * np.where(variance == 0.0, 1e-3, 1.0), bias), agent.layers[1]]
    loop.network = check_pose.Network(agent._replace(variance=variance, layers=layers))
    with pytest.raises(Refused, match="clipped"):
        loop.check_closed(place, heading, loop.bounds(place, heading))


def test_units_are_within_their_bounds_in_single_precision(files: dict[str, bytes]) -> None:
    """Terms of 10^5 that cancel, one sum after another, where the exact unit is its bias."""
    agent = read_agent(files["agent.safetensors"], 8)
    weight, bias = (x.copy() for x in agent.layers[0])
    weight[1], bias[1] = weight[0], bias[0]
    rows = np.zeros_like(agent.layers[1][0])
    rows[0, :2] = 1e6, -1e6
    shift = agent.layers[1][1] - 0.003  # which no number near 10^5 has room for
    net = check_pose.Network(agent._replace(layers=[(weight, bias), (rows, shift)]))
    x = np.random.default_rng(0).uniform(-0.05, 0.05, 500).astype(np.float32)
    columns: list[Any] = [(0.0, 0.0)] * 8
    columns[2] = np.zeros(1), np.zeros(1)
    columns[4] = x.astype(float), x.astype(float)
    base, ends = net._inputs(*net._single, columns, 4, 2)
    flown = np.full(len(x), shift[0], np.float32)
    for k in (0, 1):
        slope, b = net._units[k][1:]
        unit = np.maximum(np.float32(slope) * columns[4][0].astype(np.float32) + np.float32(b), 0)
        flown += np.float32(rows[0, k]) * unit
    low, high = (base + ends)[:, 0]
    assert (low <= flown).all()
    assert (flown <= high).all()
    assert np.abs(flown - shift[0]).max() > 1e-3
    assert (high - low).max() < 1.0


OTHER: dict[str, tuple[str, bytes, bytes]] = {
    "a heavier craft": ("spacecraft.toml", b"mass = 5.32", b"mass = 4.5"),
    "a slower craft": ("spacecraft.toml", b"inertia = 0.2045008", b"inertia = 0.17"),
    "a stronger thruster": ("spacecraft.toml", b"force = 1.0", b"force = 1.1"),
    "a turned thruster": ("spacecraft.toml", b"[1.0, -1.0]", b"[1.0, -1.1]"),
    "thrusters that share a supply": ("spacecraft.toml", b'"none"', b'"split"'),
    "pulsed thrusters": ("spacecraft.toml", b'shape = "sphere"', b'actuators = {kind = "pulsed"}'),
    "a longer period": ("config.json", b'"control_period": 0.1', b'"control_period": 0.2'),
    "another task": ("config.json", b"go-to-pose", b"go-to-position"),
}  # fmt: skip


@pytest.mark.parametrize("other", OTHER)
def test_another_agent_is_refused(
    other: str, table: dict[str, Any], files: dict[str, bytes]
) -> None:
    name, old, new = OTHER[other]
    content = files[name].replace(old, new, 1)
    assert content != files[name]
    table["agent"][name] = hashlib.sha256(content).hexdigest()
    with pytest.raises(Refused):
        judged(table, files | {name: content})


def test_flights_that_leave_are_found(certificate: bytes, files: dict[str, bytes]) -> None:
    """What the checker believes of an agent is compared with flights of it."""
    table = json.loads(certificate)
    heading = table["cells"]["heading"]
    heading[:] = [run for run in heading if run[0] > 0]  # every pulse the other way leaves these
    with pytest.raises(Refused, match="flights"):
        check_pose_as_flown(json.dumps(table).encode(), files)


# The checker's sets against states that are simulated by formulas of this test alone.

SIGNS = [[1, -1], [-1, 1], [1, 1], [-1, -1], [-1, 1], [1, -1], [-1, -1], [1, 1]]
ALONG = np.array(SIGNS) * math.sqrt(0.5)
LEVER = np.array([-1, 1, -1, 1, -1, 1, -1, 1])
DIAGONALS = np.array([[1.0, -1.0], [1.0, 1.0]]) * math.sqrt(0.5)


def violations(
    module: ModuleType,
    table: dict[str, Any],
    files: dict[str, bytes],
    weights: dict[str, np.ndarray],
) -> list[str]:
    """States of random cells whose command, image or path is outside what a checker says of their cells."""
    random = np.random.default_rng(2)
    loop = module.Loop(table, files)
    place, heading = (loop.cells(table["cells"][name], name) for name in ("place", "heading"))
    bounds = loop.bounds(place, heading)
    # States of pairs of single cells, and the other position somewhere in its set, more often at its rim.
    pairs = 150
    states = 200
    count = pairs * states

    def drawn(cells: Any, number: int, repeats: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        every = np.argwhere(cells.inside)
        somewhere = random.integers(0, len(every), number)
        rim = random.choice([*range(60), *range(-60, 0)], number)
        chosen = np.repeat(every[np.where(random.random(number) < 0.5, somewhere, rim)], repeats, 0)
        inner = random.choice([1e-9, 0.5, 1.0 - 1e-9], (len(chosen), 2))
        rate, position = ((chosen + inner - cells.half) * cells.width).T
        return chosen, position, rate

    off = table["uncertainty"]

    def error(size: float) -> np.ndarray:
        turn = random.uniform(0.0, 2.0 * np.pi, count)
        return size * np.stack((np.cos(turn), np.sin(turn)), axis=1)

    def either(size: float) -> np.ndarray:
        return size * random.choice([-1.0, 1.0], count)

    def commanded(p: np.ndarray, v: np.ndarray, angle: np.ndarray, spin: np.ndarray) -> np.ndarray:
        """Commands of readings in the body frame, off by as much as they may be."""
        read = angle + either(off["heading"])
        way = turned(-(p + error(off["position"])), -read)
        velocity = turned(v + error(off["velocity"]), -read)
        sine = np.sin(-(angle + either(off["heading"])))
        rest = (spin + either(off["spin"]), np.ones(count), way, np.sqrt(1.0 - sine**2), sine)
        h = np.column_stack((velocity, *rest))
        for k in (0, 2):
            name = f"features_extractor.trunk.{k}"
            h = np.maximum(h @ weights[f"{name}.weight"].T + weights[f"{name}.bias"], 0.0)
        score = h @ weights["action_net.weight"].T + weights["action_net.bias"]
        return (score[:, 1::2] - score[:, ::2] > 0.0).astype(float)

    # Bounds of thrust and of what a craft sees, where they are wide.
    broken = []
    low = (1 - off["thrust"]) / (1 + off["mass"])
    high = (1 + off["thrust"]) / (1 - off["mass"])
    for angle in (0.0, 0.5):
        pushes = loop._pulls(module.Parts(0.1, 0.1, angle, 0.0))
        seen = loop._seen((np.array(-0.3), np.array(0.7)), 1.0, angle)
        for sign in (-1.0, 1.0):
            for level, (least, most) in pushes.items():
                exact = [
                    f / MASS * (level * math.cos(angle) + sign * 2.0 * math.sin(angle))
                    for f in (low, high)
                ]
                broken += [f"push {level}"] * (not (least <= min(exact) and max(exact) <= most))
            across = sign * math.sin(angle)
            if not (
                seen[0] <= -0.3 * math.cos(angle) + across
                and 0.7 * math.cos(angle) + across <= seen[1]
            ):
                broken.append("seen")
    # Commands of states of many cells, then images of a few.
    levels = loop.place_levels(place, bounds), loop.heading_levels(heading, bounds)
    for number, repeats in ((count, 1), (pairs, states)):
        cx, x, vx = drawn(place, number, repeats)
        _, y, vy = drawn(place, count, 1)
        ch, angle, spin = drawn(heading, number, repeats)
        p = np.stack((x, y), axis=1) @ DIAGONALS
        v = np.stack((vx, vy), axis=1) @ DIAGONALS
        # What pulses before the decision still let through is in the cell's state, and not in the craft's.
        factor = random.choice([low, high], count)
        before = commanded(p, v, angle, spin)
        until = before * off["shutting"] * random.integers(0, 2, before.shape)
        pull = turned((until @ ALONG) * (factor / MASS)[:, None], angle)
        fall = turned((until**2 @ ALONG) * (0.5 * factor / MASS)[:, None], angle)
        at = (
            p + fall,
            v - pull,
            angle + 0.5 * factor * (until**2 @ LEVER) * 0.31 / INERTIA,
            spin - factor * (until @ LEVER) * 0.31 / INERTIA,
        )
        opened = commanded(*at)
        push = np.rint(opened @ ALONG @ DIAGONALS.T).astype(int)
        twist = np.rint(opened @ LEVER).astype(int)
        for name, cells, chosen, mine in (
            ("push", levels[0], cx, push[:, 0]),
            ("twist", levels[1], ch, twist),
        ):
            for level in np.unique(mine):
                rows = chosen[mine == level]
                may = cells.get(
                    level,
                    np.zeros(
                        place.inside.shape if name == "push" else heading.inside.shape, dtype=bool
                    ),
                )
                broken += [f"{name} {level}"] * int((~may[rows[:, 0], rows[:, 1]]).sum())
    if broken:
        return broken
    # Images, by small steps in the world frame.
    # Each valve opens and shuts late by itself; the last part has only what is let through after the period.
    most = max(off["opening"], off["shutting"])
    instants = np.unique(
        [
            *np.linspace(0.0, most, 5),
            *np.linspace(most, PERIOD, 64),
            *(PERIOD + np.linspace(0.0, most, 5)),
        ]
    )
    # A thruster that stays open may be taken for one that shuts and opens again, which is more than may happen.
    begins = off["opening"] * random.integers(0, 2, opened.shape)
    ends = PERIOD + off["shutting"] * random.integers(0, 2, opened.shape)
    farthest = np.zeros(2)
    position, speed, heading_now, rate = at
    for first, last in itertools.pairwise(instants):
        dt = last - first
        thrust = opened * np.clip(
            (np.minimum(ends, last) - np.maximum(begins, first)) / dt, 0.0, 1.0
        )
        thrust = thrust + before * np.clip((until - first) / dt, 0.0, 1.0)
        middle = heading_now + 0.5 * dt * rate
        pull = turned(thrust @ ALONG, middle) * (factor / MASS)[:, None]
        alpha = factor * (thrust @ LEVER) * 0.31 / INERTIA
        position = position + dt * speed + 0.5 * dt * dt * pull
        speed = speed + dt * pull
        heading_now = heading_now + dt * rate + 0.5 * dt * dt * alpha
        rate = rate + dt * alpha
        farthest = np.maximum(
            farthest, (np.abs(position @ DIAGONALS.T).max(), np.abs(heading_now).max())
        )
    position = position - most * speed
    heading_now = heading_now - most * rate
    parts = (
        (
            "place",
            place,
            cx,
            levels[0],
            loop._pulls(bounds),
            loop.late.slip(loop._turned(bounds)),
            position @ DIAGONALS[0],
            speed @ DIAGONALS[0],
        ),
        ("heading", heading, ch, levels[1], loop._twists(), loop.late.spin_slip, heading_now, rate),
    )
    for name, cells, chosen, may, pushes, slip, where, fast in parts:
        for first in range(0, count, states):
            own = cells.like()
            own.inside[tuple(chosen[first])] = True
            image = own.moved(may, pushes, PERIOD, slip).inside
            inside = np.zeros(states, dtype=bool)
            part = slice(first, first + states)
            for a in (-3e-5, 3e-5):
                for b in (-3e-5, 3e-5):
                    row = np.floor(fast[part] / cells.width[0] + a).astype(int) + cells.half[0]
                    column = np.floor(where[part] / cells.width[1] + b).astype(int) + cells.half[1]
                    row, column = (
                        np.clip(k, 0, n - 1)
                        for k, n in zip((row, column), image.shape, strict=True)
                    )
                    inside |= image[row, column]
            broken += [f"{name} {first}"] * int((~inside).sum())
    within = loop.between_decisions(bounds)
    if not (farthest <= (within.place, within.heading)).all():
        broken.append(f"a path reaches {farthest}")
    return broken


def turned(vectors: np.ndarray, angle: np.ndarray) -> np.ndarray:
    c = np.cos(angle)
    s = np.sin(angle)
    return np.stack(
        (c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]), axis=1
    )


def test_simulated_states_are_in_the_checkers_sets(
    example: ModuleType, table: dict[str, Any], files: dict[str, bytes]
) -> None:
    assert violations(check_pose, table, files, example.network()) == []


@pytest.mark.slow
def test_far_starts_come_into_it(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A short way, by the command, and the same claim with too little time."""
    file = tmp_path / "far.json"
    limits = "--property position=0.05,heading=5 --from position=0.052,heading=5.5"
    assert main(f"prove {folder} {limits} --output {file}".split()) == 0
    assert "at rest, it is after" in capsys.readouterr().out.replace("\n", " ")
    table = json.loads(file.read_bytes())
    table["reach"]["periods"] = 10
    # Of positions, as if headings were in their set at once.
    monkeypatch.setattr(check_pose.Loop, "_turn", lambda *_: (0, 0, (0.0, 0.0)))
    with pytest.raises(Refused, match="periods"):
        judged(table, {name: (folder / name).read_bytes() for name in FILES})


def test_a_report_says_what_is_proved_of_poses(
    files: dict[str, bytes], certificate: bytes, table: dict[str, Any], tmp_path: Path
) -> None:
    """A claim, what was checked here, what has another agent, and what is damaged."""

    def section(content: bytes) -> Section:
        (tmp_path / "proof.json").write_bytes(content)
        return proof_section(tmp_path / "proof.json", {})

    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    claimed = section(certificate).findings[0]
    assert claimed.passed is None
    assert "0.05 m and 5.0 degrees" in claimed.text
    assert proof_entry(tmp_path).keys() == {"claimed"}
    assert main(f"prove {tmp_path} --check {tmp_path}/proof.json".split()) == 0
    checked = section(certificate)
    assert checked.findings[0].passed
    cells = sum(b - a for runs in table["cells"].values() for _, a, b in runs)
    assert ["cells", f"{cells:,}"] in checked.tables[0].rows
    assert proof_entry(tmp_path)["proved"]["cells"] == cells
    # Far starts are not within the limits from the beginning.
    off = {name: 0.0 for name in ("opening", "shutting")}
    far = table | {"reach": {"sectors": 1, "periods": 9}, "uncertainty": table["uncertainty"] | off}
    far["start"] = table["start"] | {"speed": 0.0, "spin": 0.0}
    assert "it is in the end within" in section(json.dumps(far).encode()).findings[0].text
    for content in (json.dumps(table | {"format": 1}).encode(), certificate[:-9]):
        assert section(content).findings[0].passed is False
    (tmp_path / "spacecraft.toml").write_bytes(files["spacecraft.toml"] + b"\n")
    assert section(certificate).findings[0].passed is False
    assert proof_entry(tmp_path) == {}


@pytest.mark.slow
@pytest.mark.parametrize("error", ERRORS["check_pose"])
def test_a_checker_with_a_planted_error_is_found(
    error: str, example: ModuleType, table: dict[str, Any], files: dict[str, bytes]
) -> None:
    module = planted_in(
        ["rans_proof.craft_reader", check_pose.__name__], *ERRORS["check_pose"][error]
    )
    # Room for late valves would hide errors.
    table["uncertainty"].update(opening=0.0, shutting=0.0)
    try:
        broken = violations(module, table, files, example.network())
    except (Refused, ValueError):  # of the true certificate, or no command is possible
        return
    assert broken


def late_errors(module: ModuleType) -> list[str]:
    """Where bounds of late valves are below what thrusters at extreme delays do, or far above it.

    Motion along one axis, and about the third, is exact: thrust from a late beginning to a late end.
    """
    along = [(1, 0), (-1, 0), (0, 1), (0, -1), (-1, 0), (1, 0), (0, -1), (0, 1)]
    pull = 0.2
    twist = 1.6
    errors = []
    for opening, shutting in ((0.001, 0.001), (0.002, 0.0), (0.0, 0.002)):
        off = {"mass": 0.01, "position": 0.003, "spin": 0.004}
        off |= {"opening": opening, "shutting": shutting}
        late = module.Late(off, along, pull, twist, (2, 4))
        # All thrusters of one sign shut late, and those of the other one open late.
        for name, sign, size, bound in (
            ("speed", np.array([a[0] for a in along]), pull, late.slip(0.0)),
            ("spin", LEVER, twist, late.spin_slip),
        ):
            begins = np.where(sign < 0, opening, 0.0)
            ends = np.where(sign > 0, PERIOD + shutting, PERIOD)
            lasting = ends - begins
            rate = size * (sign * lasting).sum()
            # From rest to where the craft coasts to, less what it coasts after the period.
            path = size * (sign * lasting * (PERIOD - 0.5 * (begins + ends))).sum()
            exact = size * sign.sum() * PERIOD, size * sign.sum() * PERIOD**2 / 2.0
            change = max(abs(rate - exact[0]), abs(path - exact[1]) / PERIOD)
            if not change <= bound * (1.0 + 1e-9) <= 2.5 * change:
                errors.append(f"{name} changes by {change}, and the bound is {bound}")
        # Across: as much of the thrusters of the other diagonal as the sine of the angle.
        if not 1.4 * late.slip(0.0) < late.slip(0.5) < 1.5 * late.slip(0.0):
            errors.append("thrust across")
        # Two thrusters along each axis together, and four that turn the craft, have shut after the decision.
        tails = {
            "velocity": math.hypot(2.0, 2.0) * pull * shutting,
            "position": math.hypot(2.0, 2.0) * pull * shutting**2 / 2.0,
            "spin": 4.0 * twist * shutting,
            "heading": 4.0 * twist * shutting**2 / 2.0,
        }
        read = late.readings(off)
        for name, value in tails.items():
            more = read.get(name, late.unread[name]) - off.get(name, 0.0)
            if not value * (1.0 - 1e-9) <= more <= value * 1.2 + 1e-15:
                errors.append(f"a reading of {name} lacks {value}, and the bound is {more}")
        # With the spin that was read as less, and a slip at once, to the last instant at which a valve may shut.
        turn = (20.0 + tails["spin"]) * shutting + late.spin_slip * (PERIOD + shutting)
        if not turn <= late.turned(20.0, PERIOD) <= 2.1 * turn:
            errors.append("the turn")
    return errors


def test_late_valves_are_in_their_bounds() -> None:
    assert late_errors(check_late) == []


@pytest.mark.parametrize("error", ERRORS["check_late"])
def test_an_error_planted_into_late_valves_is_found(error: str) -> None:
    name = check_late.__name__
    assert late_errors(planted_in([name], *ERRORS["check_late"][error]))


def test_readings_of_a_check_lack_what_valves_let_through(
    table: dict[str, Any], files: dict[str, bytes]
) -> None:
    off = table["uncertainty"]
    loop = check_pose.Loop(table, files)
    assert loop.off["spin"] >= off["spin"] + 4.0 * 0.31 / INERTIA * off["shutting"]
    assert loop.off["velocity"] >= off["velocity"] + math.sqrt(8.0) / MASS * off["shutting"]


@pytest.mark.slow
def test_a_checker_whose_rates_do_not_slip_is_found(
    example: ModuleType, table: dict[str, Any], files: dict[str, bytes]
) -> None:
    name = check_pose.__name__
    module = planted_in([name], "more = slip / self.width[0]", "more = 0.0")
    assert violations(module, table, files, example.network())
