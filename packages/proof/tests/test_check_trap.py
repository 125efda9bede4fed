"""The checker of trapping sets is sound: simulations lie inside its sets, and planted errors are found by that."""

from __future__ import annotations

import contextlib
import itertools
from types import ModuleType

import numpy as np
import pytest

pytest.importorskip("flint")

from rans_proof import check_trap
from rans_proof.balls import Refused

from .planted import ERRORS, planted_in
from .trap_harness import Case, Findings, random_case, violations

SEEDS = range(12)


def found(module: ModuleType, seeds: range = SEEDS) -> list[str]:
    """Where a checker is unsound, up to the first case in which it is."""
    for seed in seeds:
        case = random_case(seed)
        broken = violations(module, case).broken + cover_errors(module, case)
        if broken:
            return broken
    return []


def test_simulations_lie_inside_the_checkers_sets() -> None:
    assert found(check_trap, SEEDS[:2]) == []


@pytest.mark.slow
def test_more_simulations_lie_inside_the_checkers_sets() -> None:
    assert found(check_trap, range(2, 20)) == []


@pytest.mark.slow
def test_the_checkers_sets_are_tight() -> None:
    """A set of everything would be sound too. Simulations of 24 states of a cell miss a part of its image."""
    every: list[Findings] = [violations(check_trap, random_case(seed)) for seed in SEEDS]
    bounds = {
        "rings": (1.1, 1.5),
        "turns": (1.1, 2.5),
        "speeds": (1.1, 1.6),
        "commands": (1.5, 16.0),  # of 16 at most
    }
    for name, (usual, largest) in bounds.items():
        values = np.concatenate([getattr(findings, name) for findings in every])
        assert np.median(values) < usual, name
        assert np.quantile(values, 0.99) < largest, name


def cover_errors(module: ModuleType, case: Case) -> list[str]:
    """Accepted sets that lack one cell with a start, and sets of all cells with starts that are refused."""
    grid = case.table.grid
    off = case.table.uncertainty
    loop = case.loop(module)
    low = (1 - off["thrust"]) / (1 + off["mass"])
    random = np.random.default_rng(7)
    errors = []
    for speed, spin in ((0.0, 0.0), (0.05, 0.0), (0.0, 0.2), (0.0500001, 0.2000001), (0.11, 0.03)):
        # A cell holds a start if its slowest state is slower; the weakest craft has the thinnest layers.
        ring = np.arange(grid["rings"]) / grid["rings"] * case.table.keep["speed"]
        edges = np.arange(-grid["layers"], grid["layers"] + 1) * case.step * low / grid["fine"]
        nearest = np.minimum(np.abs(edges[:-1]), np.abs(edges[1:]))
        needed = np.zeros((grid["rings"], grid["sectors"], 2 * grid["layers"]), dtype=bool)
        slow, still = ring < speed * (1 + 1e-12), nearest < spin * (1 + 1e-12)
        slow[0] = True
        still[grid["layers"] - 1 : grid["layers"] + 1] = True
        needed[np.ix_(slow, np.ones(grid["sectors"], dtype=bool), still)] = True
        start = {"speed": speed, "spin": spin}
        if not accepts(module, loop, start, needed):
            errors.append(f"all cells that hold a start up to {start} are refused")
        cells = np.argwhere(needed)
        corners = cells[[0, -1]]  # where cells that are looked for begin and end
        for cell in np.concatenate((cells[random.integers(len(cells), size=12)], corners)):
            gap = needed.copy()
            gap[tuple(cell)] = False
            if accepts(module, loop, start, gap):
                errors.append(f"the cell {cell} that holds a start up to {start} is missed")
    return errors


def accepts(module: ModuleType, loop: object, start: dict[str, float], inside: np.ndarray) -> bool:
    try:
        loop.check_start(start, inside)  # type: ignore[attr-defined]
    except Refused:
        return False
    return True


def test_an_image_is_looked_up_where_it_is() -> None:
    """A set of the image alone is enough, and without any one of its cells it is not."""
    assert lookup_errors(check_trap) == []


LOOKED_UP = [
    *((0, 1, 22, 24, -2, 0), (2, 3, 0, 1, 0, 1), (4, 6, 5, 7, 1, 2)),
    *((1, 2, 3, 4, -12, -11), (1, 2, 3, 4, 11, 12)),  # from which a pulse leaves the layers
    *((10, 11, k, k + 1, -12, -11) for k in range(0, 24, 3)),  # where the speed is near its limit
]


def lookup_errors(module: ModuleType) -> list[str]:
    """Sets without a cell of an image that are accepted, and the image itself where it is refused."""
    errors = []
    for seed in SEEDS[:6]:
        case = random_case(seed)
        loop, grid = case.loop(module), case.table.grid
        shape = (grid["rings"], grid["sectors"], 2 * grid["layers"])
        for cell in LOOKED_UP:
            for command in itertools.islice(itertools.product((0, 1), repeat=3), 8):
                command = (*command, *(0,) * (len(case.lever) - 3))
                image = loop.image(cell, command)
                layers = [k + grid["layers"] for k in image.layers]
                beyond = image.rings[1] > shape[0] or layers[0] < 0 or layers[1] > shape[2]
                if beyond or (image.fastest is not None and not image.fastest <= 0.15):
                    if not loop.leaves(cell, command, np.ones(shape, dtype=bool)):
                        errors.append(f"{cell} under {command} leaves the grid")
                    continue
                inside = np.zeros(shape, dtype=bool)
                columns = [k % shape[1] for k in range(*image.sectors)]
                cells = [*itertools.product(range(*image.rings), columns, range(*layers))]
                for each in cells:
                    inside[each] = True
                if loop.leaves(cell, command, inside):
                    errors.append(f"the image of {cell} under {command} is refused")
                for each in (cells[0], cells[-1], cells[len(cells) // 2]):
                    inside[each] = False
                    if not loop.leaves(cell, command, inside):
                        errors.append(f"{cell} under {command} leaves the cells")
                    inside[each] = True
    return errors


def with_error(old: str, new: str) -> ModuleType:
    """The checker with a text of its source in the place of another."""
    return planted_in(["rans_proof.craft_reader", check_trap.__name__], old, new)


@pytest.mark.slow
@pytest.mark.parametrize("error", ERRORS["check_trap"])
def test_a_checker_with_a_planted_error_is_found(error: str) -> None:
    assert found(with_error(*ERRORS["check_trap"][error]))


@pytest.mark.parametrize(("old", "new"), ERRORS["check_trap_lookup"])
def test_a_lookup_with_a_planted_error_is_found(old: str, new: str) -> None:
    module = with_error(old, new)
    with contextlib.suppress(IndexError):  # beyond the grid
        assert lookup_errors(module)
