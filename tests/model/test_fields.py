"""Fields against NumPy, SciPy's Rotation and complex numbers, in every library that carries them."""

from __future__ import annotations

import ast
import cmath
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from rans.model import fields
from rans.model.fields import (
    Heading,
    Quat,
    Vec2,
    Vec3,
    ascending,
    at_least,
    fraction_of,
    leaves,
    map_leaves,
    where,
    wrap,
)

numbers = st.floats(-10, 10, allow_subnormal=False)
angles = st.floats(-50, 50, allow_subnormal=False)
rotations = st.tuples(*[st.floats(-4, 4, allow_subnormal=False)] * 3).map(Rotation.from_rotvec)
vectors = st.tuples(numbers, numbers, numbers)
Triple = tuple[float, float, float]
libraries = pytest.mark.parametrize("library", ["float", "numpy", "torch", "casadi"])


def in_library(library: str, function: Callable[..., Any], *values: float) -> list[float]:
    """The leaves of ``function(*values)``, computed by one of the libraries."""
    if library == "casadi":
        casadi = pytest.importorskip("casadi")
        symbols = [casadi.SX.sym(f"x{i}") for i in range(len(values))]
        traced = casadi.Function("f", symbols, list(leaves_of(function(*symbols))))
        out = traced(*values)
        return [float(x) for x in (out if isinstance(out, tuple) else (out,))]
    if library == "torch":
        torch = pytest.importorskip("torch")
        given_fields = [torch.tensor([0.1, x], dtype=torch.float64) for x in values]
    elif library == "numpy":
        given_fields = [np.array([0.1, x]) for x in values]
    else:
        return [float(x) for x in leaves_of(function(*values))]
    return [float(x[1]) for x in leaves_of(function(*given_fields))]


def leaves_of(result: Any) -> tuple[Any, ...]:
    parts = result if isinstance(result, tuple) else (result,)
    return tuple(x for part in parts for x in leaves(part))


def assert_close(actual: Any, expected: Any, size: float = 1.0) -> None:
    """Equal but for the rounding of a few dozen float64 operations on numbers of this size."""
    np.testing.assert_allclose(actual, expected, rtol=1e-13, atol=1e-13 * size)


def quat(rotation: Rotation) -> Quat:
    x, y, z, w = rotation.as_quat()
    return Quat(w, x, y, z)


def rotation_of(q: Quat) -> Rotation:
    return Rotation.from_quat([q.x, q.y, q.z, q.w])


@libraries
@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        ("sin", [math.pi / 6], 0.5),
        ("cos", [2 * math.pi / 3], -0.5),
        ("exp", [-1.0], 0.36787944117144233),
        ("sqrt", [6.25], 2.5),
        ("absolute", [-3.5], 3.5),
        ("floor", [-0.5], -1.0),
        ("floor", [2.75], 2.0),
        ("atan2", [1.0, -1.0], 3 * math.pi / 4),
        ("atan2", [-2.0, 0.0], -math.pi / 2),
    ],
)
def test_functions_mean_the_same_in_every_library(library, name, arguments, expected):
    assert in_library(library, getattr(fields, name), *arguments) == pytest.approx(
        [expected], abs=1e-15
    )


@libraries
def test_at_least_raises_only_what_is_below(library):
    assert in_library(library, lambda x: at_least(x, 1.0), 0.25) == [1.0]
    assert in_library(library, lambda x: at_least(x, 1.0), 4.0) == [4.0]


@libraries
@pytest.mark.parametrize(
    ("part", "whole", "fraction"),
    [
        (1.0, 4.0, 0.25),
        (5.0, 4.0, 1.0),
        (-1.0, 4.0, 0.0),
        # A whole that is nothing but rounding has no huge fractions of either sign.
        (1.0, -1e-16, 1.0),
        (-1e-7, -1e-16, 0.0),
        (1e-7, 0.0, 1.0),
        (0.0, 0.0, 0.0),
    ],
)
def test_a_fraction_is_never_more_than_all(library, part, whole, fraction):
    assert in_library(library, fraction_of, part, whole) == [fraction]


FLOORS = {"at_least", "max", "maximum", "clamp"}
PROVED = {
    "conditions._check_propellant": "a vector over its length: at most 1",
    "drift.step_goal": "sin(rate t / 2) over the rate, a root: at most t / 2",
    "fields.fraction_of": "from 0 to 1",
    "passive_safety._least_of_segments": "a vector over its length: at most 1",
}
"""Denominators with a floor whose quotient is bounded, with the reason."""


def floors(source: str) -> list[str]:
    """Functions of a module that divide by a value with a tiny floor."""
    result = []
    tree = ast.parse(source)
    constants = {
        target.id: line.value.value
        for line in tree.body
        if isinstance(line, ast.Assign) and isinstance(line.value, ast.Constant)
        for target in line.targets
        if isinstance(target, ast.Name)
    }
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        for node in ast.walk(function):
            if not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div)):
                continue
            called = [x for x in ast.walk(node.right) if isinstance(x, ast.Call)]
            names = {getattr(x.func, "id", getattr(x.func, "attr", "")) for x in called}
            numbers = [
                constants.get(getattr(x, "id", ""), getattr(x, "value", None))
                for x in ast.walk(node.right)
            ]
            tiny = [x for x in numbers if isinstance(x, float) and 0.0 < x < 1e-6]
            if FLOORS & names and tiny:
                result.append(function.name)
    return result


def test_nothing_that_moves_a_craft_divides_by_a_floor():
    """Where the sign of the value is not proved, its quotient has any size: `fraction_of` is for fractions."""
    package = Path(fields.__file__).parents[1]
    folders = ("model", "effectors", "randomization")
    files = [file for folder in folders for file in (package / folder).glob("*.py")]
    files += (package.parent / "packages" / "missions" / "rans_missions").glob("*.py")
    assert floors("T = 1e-9\ndef f(x):\n    return 1.0 / (x + at_least(x, T))\n") == ["f"]
    places = {
        f"{file.stem}.{name}" for file in files for name in floors(file.read_text(encoding="utf-8"))
    }
    assert places == set(PROVED)


@given(angles)
def test_wrap_keeps_the_angle_and_its_range(angle):
    wrapped = float(wrap(angle))
    # 8 turns leave 8 eps of rounding, which may step over either end
    assert -math.pi - 1e-14 <= wrapped <= math.pi + 1e-14
    assert abs(math.remainder(wrapped - angle, math.tau)) < 1e-13


@given(rotations, st.sampled_from([-1.0, 1.0]), st.floats(0.2, 5.0))
def test_quaternion_angle_ignores_sign_and_length(rotation, sign, length):
    q = map_leaves(lambda x: x * sign * length, quat(rotation))
    assert_close(q.magnitude(), rotation.magnitude())
    assert 0.0 <= q.magnitude() <= math.pi + 1e-15
    assert math.hypot(*leaves(q.normalised())) == pytest.approx(1.0, abs=1e-15)
    assert_close(rotation_of(q.normalised()).as_matrix(), rotation.as_matrix())


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-5, math.pi - 1e-9, math.pi])
def test_angles_at_both_ends_keep_their_digits(angle):
    """Where an arccos of the trace would lose half of them or give NaN."""
    q = Quat(math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0)
    assert float(q.magnitude()) == pytest.approx(angle, rel=1e-13, abs=1e-15)
    assert float(Heading(-angle).magnitude()) == pytest.approx(angle, rel=1e-13, abs=1e-15)


@pytest.mark.parametrize("library", ["numpy", "torch"])
def test_single_precision_stays_single(library):
    """A constant that promoted to float64 would double the memory traffic of the fast engine."""
    torch = pytest.importorskip("torch")
    half = np.full(2, 0.5, np.float32) if library == "numpy" else torch.full((2,), 0.5)
    expected = np.dtype(np.float32) if library == "numpy" else torch.float32
    heading = Heading(half)
    q = Quat(half, half, half, half)
    for tree in (
        heading.normalised(),
        heading.rotate(Vec2(half, half)),
        heading.to(heading).magnitude(),
        q.normalised(),
        q.rotate(Vec3(half, half, half)),
        q.to(q).magnitude(),
        at_least(half, 1.0),
        where(half < 1.0, half, 0.0 * half),
        Vec3(half, half, half).norm(),
    ):
        assert {x.dtype for x in leaves(tree)} == {expected}
    assert {x.dtype for x in (*heading.columns(), *q.columns())} == {expected}


def test_fields_in_ascending_order():
    columns = np.random.default_rng(0).integers(0, 9, (6, 50)).astype(float)
    assert np.array_equal(ascending(list(columns)), np.sort(columns, axis=0))


@given(angles, angles, vectors)
def test_headings_are_unit_complex_numbers(a, b, v):
    here = Heading(a)
    there = Heading(b)
    rotated = complex(*here.rotate(Vec2(*v[:2])).columns())
    assert cmath.isclose(rotated, complex(*v[:2]) * cmath.exp(1j * a), rel_tol=1e-13, abs_tol=1e-13)
    assert cmath.isclose(complex(*here.columns()), cmath.exp(1j * a), abs_tol=1e-15)
    assert cmath.isclose(complex(*here.inverse().columns()), cmath.exp(-1j * a), abs_tol=1e-15)
    turn = cmath.phase(cmath.exp(1j * b) / cmath.exp(1j * a))
    assert float(here.to(there).magnitude()) == pytest.approx(abs(turn), abs=1e-13)
    assert float(here.magnitude()) <= math.pi + 1e-14
    assert cmath.isclose(complex(*here.normalised().columns()), cmath.exp(1j * a), abs_tol=1e-13)
    assert abs(here.normalised().angle) <= math.pi + 1e-14
