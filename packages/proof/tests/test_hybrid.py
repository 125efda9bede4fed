"""Chains of affine modes with an abort: the safe rendezvous is proved, and false certificates are refused."""

from __future__ import annotations

import copy
import json
import tomllib
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from rans_proof.hybrid import Open, search
from scipy.linalg import expm

from .planted import ERRORS, Change, forge, planted_in

pytest.importorskip("flint")

from flint import arb, arb_mat
from rans_proof import check_hybrid
from rans_proof.balls import Refused

from .test_archcomp import script

PROBLEM: dict[str, Any] = tomllib.loads("""
name = "a mass that is braked, passes a gate and may be aborted"
horizon = "8"
abort = ["0.5", "3"]
[start]
lower = ["-4", "0.9", "1", "-0.05"]
upper = ["-3.8", "1", "1.1", "0.05"]
[[mode]]
name = "cruise"
rates = [
    ["0", "0", "1", "0"],
    ["0", "0", "0", "1"],
    ["0", "0", "0", "0.02"],
    ["0", "0", "-0.02", "0"],
]
keep = [["0", "0", "1", "0", "0"]]
until = ["1", "0", "0", "0", "2"]
[[mode]]
name = "brake"
rates = [
    ["0", "0", "1", "0"],
    ["0", "0", "0", "1"],
    ["-0.5", "0", "-2", "0"],
    ["0", "0", "0", "-2"],
]
keep = [["0", "0", "-1", "0", "1.2"], ["-1", "0", "0", "0", "0"]]
[passive]
rates = [
    ["0", "0", "1", "0"],
    ["0", "0", "0", "1"],
    ["0", "0", "0", "0.02"],
    ["0", "0", "-0.02", "0"],
]
half = "0.05"
""")
"""Flights pass x = -2 m after about 2 s, 0.5 m to the side of the origin."""


def flown(problem: dict[str, Any], count: int = 60) -> dict[str, float]:
    """Least value of the modes' functions and least largest coordinate of passive flights, by dense steps."""
    random = np.random.default_rng(2)
    low, high = (np.array(problem["start"][end], float) for end in ("lower", "upper"))
    horizon, step = float(problem["horizon"]), 1.0 / 128
    first, second = (np.array(mode["rates"], float) for mode in problem["mode"])
    guard = np.array(problem["mode"][0]["until"], float)
    coast = expm(step * np.array(problem["passive"]["rates"], float))
    begin, end = (float(t) for t in problem["abort"])
    kept, missed = np.inf, np.inf
    x = low + (high - low) * random.integers(0, 2, (count, 4))
    mode = np.zeros(count, int)
    moves = np.stack([expm(step * first), expm(step * second)])
    for k in range(int(end / step)):
        for number in (0, 1):
            rows = np.array(problem["mode"][number]["keep"], float)
            values = x[mode == number] @ rows[:, :-1].T + rows[:, -1]
            kept = min(kept, values.min(initial=np.inf))
        if k * step >= begin and k % 16 == 0:
            y = x
            for _ in range(int((horizon - k * step) / step)):
                missed = min(missed, np.abs(y[:, :2]).max(axis=1).min())
                y = y @ coast.T
        x = np.einsum("nij,nj->ni", moves[mode], x)
        mode = np.where(x @ guard[:-1] + guard[-1] >= 0.0, 1, mode)
    return {"kept": float(kept), "missed": float(missed)}


def certificate(problem: dict[str, Any] = PROBLEM, cells: tuple[int, ...] = (2, 1, 1, 1)) -> Any:
    return {"format": 1, "problem": problem, "cells": cells, "proofs": search(problem, cells)}


def judged(table: Any, module: ModuleType = check_hybrid) -> float:
    return module.check(json.dumps(table).encode())


@pytest.fixture(scope="module")
def honest() -> dict[str, Any]:
    return json.loads(json.dumps(certificate()))


def test_an_honest_certificate_is_accepted(honest: dict[str, Any]) -> None:
    """What is accepted is true of dense flights, and nearly as much as they have."""
    least = flown(PROBLEM)
    assert least["kept"] > 0.0
    found = judged(honest)
    assert 0.0 < found <= np.sqrt(2.0) * (least["missed"] - 0.05)


def test_what_flights_break_is_not_proved() -> None:
    """A square as large as the nearest flight, or a speed that is reached, has no proof."""
    least = flown(PROBLEM)
    large = copy.deepcopy(PROBLEM)
    large["passive"]["half"] = f"{least['missed'] + 0.01:.4f}"
    slow = copy.deepcopy(PROBLEM)
    slow["mode"][1]["keep"][0] = ["0", "0", "-1", "0", "1.05"]
    for false in (large, slow):
        with pytest.raises(Open):
            search(false, (1, 1, 1, 1))


def of_gate(constant: str) -> Callable[[Any], None]:
    """The proof of a gate elsewhere."""

    def change(table: Any) -> None:
        other = copy.deepcopy(PROBLEM)
        other["mode"][0]["until"][4] = constant
        table["proofs"] = json.loads(json.dumps(certificate(other)))["proofs"]

    return change


BRAKE, CRUISE = "proofs.1.modes.1", "proofs.0.modes.0"
FORGED: dict[str, Change] = {
    "a larger square": ("problem.passive.half", "0.7"),
    "a negative square": ("problem.passive.half", "-9"),
    "a slower limit": ("problem.mode.1.keep.0.4", "1.05"),
    "a function more": lambda t: t["problem"]["mode"][0]["keep"].append(["0", "0", "0", "1", "0"]),
    "other starts": ("problem.start.lower.1", "-1"),
    "wider starts": ("problem.start.lower.0", "-9"),
    "an earlier abort": ("problem.abort.0", "0.25"),
    "a later abort": ("problem.abort.1", "7"),
    "an abort backwards": ("problem.abort", ["3", "0.5"]),
    "a longer horizon": ("problem.horizon", "80"),
    "another gate": ("problem.mode.0.until.4", "1"),
    "a gate that is not reached": ("problem.mode.0.until.4", "-50"),
    "a gate at the start": ("problem.mode.0.until.4", "4.5"),
    "another rate": ("problem.mode.1.rates.2.2", "2"),
    "another passive rate": ("problem.passive.rates.1.1", "-3"),
    "no gate": lambda t: t["problem"]["mode"][0].pop("until"),
    "the last mode only": lambda t: t["problem"]["mode"].pop(0),
    "no mode": ("problem.mode", []),
    "fewer cells": lambda t: t["proofs"].pop(),
    "another number of cells": ("cells", [1, 1, 1, 1]),
    "no cells": lambda t: t.update(cells=[0, 1, 1, 1], proofs=[]),
    "cells of truth": ("cells", [2, True, 1, 1]),
    "a shorter time in a mode": (f"{BRAKE}.keep.box.0.1", 0.5),
    "a later time in a mode": (f"{BRAKE}.keep.box.0.0", 0.5),
    "fewer aborts": (f"{BRAKE}.abort.box.0.1", 0.01),
    "later aborts": (f"{CRUISE}.abort.box.0.0", 1.0),
    "a shorter passive flight": (f"{BRAKE}.abort.box.1.1", 1.0),
    "a later passive flight": (f"{BRAKE}.abort.box.1.0", 1.0),
    "no aborts": (f"{BRAKE}.abort", None),
    "an earlier gate": (f"{CRUISE}.end", [0.5, 1.0]),
    "a later gate": (f"{CRUISE}.end", [3.0, 4.0]),
    "the proof of an earlier gate": of_gate("3.2"),
    "the proof of a later gate": of_gate("1.3"),
    "a gate at once": (f"{CRUISE}.end", [0.0, 4.0]),
    "a tree of another axis": (f"{BRAKE}.abort.tree", [2, [], []]),
    "half a tree": (f"{BRAKE}.abort.tree", [0, []]),
    "no tree": (f"{BRAKE}.abort.tree", None),
    "not a number": ("problem.horizon", "nan"),
    "a ball": ("problem.passive.half", "0 +/- 1"),
    "a number of truth": ("problem.horizon", 8),
    "another key": ("mass", 1),
    "another key of the problem": ("problem.uncertainty", 1),
    "another key of a mode": ("problem.mode.0.jump", 1),
    "another format": ("format", 2),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_certificate_is_refused(name: str, honest: dict[str, Any]) -> None:
    table = copy.deepcopy(honest)
    forge(table, FORGED[name])
    assert json.dumps(table) != json.dumps(honest)
    with pytest.raises(Refused) as caught:
        judged(table)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "content", [b"", b"junk", b"[]", b"null", b"[" * 100_000, b'{"format": 1}']
)
def test_junk_is_a_sentence(content: bytes) -> None:
    with pytest.raises(Refused):
        check_hybrid.check(content)


def sets(module: Any) -> None:
    """Flights of random rates lie in their sets, which are not much wider."""
    random = np.random.default_rng(5)
    for low, high in ((0.0, 0.0), (0.3, 0.5), (1.0, 2.5)):
        a = random.normal(size=(4, 4))
        states = random.normal(size=(4, 3)) * [1.0, 0.1, 0.05]
        columns = module.moved(
            arb_mat([[arb(x) for x in row] for row in a.tolist()]),
            arb_mat([[arb(x) for x in row] for row in states.tolist()]),
            low,
            high,
        )
        found = np.array([[float(x.mid()) for x in row] for row in columns.tolist()])
        reach = np.abs(found[:, 1:]).sum(axis=1)
        signs = np.array([[1, i, j] for i in (-1, 1) for j in (-1, 1)]).T
        path = np.concatenate(
            [expm(t * a) @ states @ signs for t in np.linspace(low, high, 81)], axis=1
        )
        off = np.abs(path - found[:, :1]).max(axis=1)
        assert (off <= reach + 1e-9).all()
        assert (reach <= 3.0 * off + 1e-9).all()


def guards(module: Any) -> None:
    """States at a guard are in the set that is moved onto it, and on the guard."""
    row = arb_mat([[arb(1), arb("0.5"), arb(0), arb(0)]]), arb("-1")
    states = arb_mat([[arb(x) for x in r] for r in np.diag([0.3, 0.2, 0.1, 0.1]).tolist()])
    centre = arb_mat([[arb(x)] for x in (0.9, 0.2, 1.0, -1.0)])
    whole = arb_mat([[*c, *r] for c, r in zip(centre.tolist(), states.tolist(), strict=True)])
    rates = arb_mat([[arb(int(j == i + 2)) for j in range(4)] for i in range(4)])
    found = module._at(row, rates, whole)
    low = float(module.lowest(*row, found))
    assert abs(low) < 1e-20
    assert abs(float(module.lowest(-row[0], -row[1], found))) < 1e-20
    # x = 0.9, y = 0.2 is on it, and stays in the set.
    reach = [sum(abs(float(x)) for x in r[1:]) for r in found.tolist()]
    for value, r, x in zip((0.9, 0.2, 1.0, -1.0), found.tolist(), reach, strict=True):
        assert abs(value - float(r[0])) <= x + 1e-12


def verdicts(module: Any) -> None:
    """The honest certificate is accepted, and forged ones are refused."""
    table = json.loads(json.dumps(certificate()))
    judged(table, module)
    for name in (
        *("a larger square", "a slower limit", "later aborts", "a later gate", "an earlier gate"),
        *("the proof of an earlier gate", "the proof of a later gate"),
        *("a shorter passive flight", "a shorter time in a mode", "fewer aborts", "a later abort"),
    ):
        false = copy.deepcopy(table)
        forge(false, FORGED[name])
        try:
            judged(false, module)
        except Refused:
            continue
        raise AssertionError(name)


PARTS = {"sets": sets, "guards": guards, "verdicts": verdicts}


@pytest.mark.parametrize("part", PARTS)
def test_the_checker_is_sound(part: str) -> None:
    PARTS[part](check_hybrid)


@pytest.mark.parametrize(("part", "old", "new"), ERRORS["check_hybrid"])
def test_an_error_of_the_checker_is_caught(part: str, old: str, new: str) -> None:
    wrong = planted_in([check_hybrid.__name__], old, new)
    with pytest.raises((AssertionError, Refused)):
        PARTS[part](wrong)


@pytest.fixture(scope="module")
def rendezvous() -> ModuleType:
    return script("rendezvous")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name == "SRA01" else (pytest.mark.slow,))
        for name in ("SRNA01", *(f"SRA0{k}" for k in range(1, 9)))
    ],
)
def test_the_safe_rendezvous_is_proved(name: str, rendezvous: ModuleType) -> None:
    assert check_hybrid.check(rendezvous.certificate(name)) > 0.0


def test_flights_agree_with_the_rendezvous(
    rendezvous: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """None of 300 breaks what is proved; of an abort after 260 min, which is unsafe, some do."""
    assert rendezvous.broken("SRA04", 300) == 0
    monkeypatch.setitem(rendezvous.SAFE, "SRA04", ("260", "260"))
    assert rendezvous.broken("SRA04", 300) > 0
