"""Networks whose sums leave the numbers of their precision are not proved, by the judgement of ONNX Runtime."""

from __future__ import annotations

import hashlib
import itertools
import json
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
import torch

from tests.support.graphs import graph

runtime = pytest.importorskip("onnxruntime")
pytest.importorskip("onnx")
pytest.importorskip("flint")

from flint import arb  # noqa: E402
from rans_proof import network, network_reader  # noqa: E402
from rans_proof.balls import Refused, matrix, network_enclosure  # noqa: E402
from rans_proof.check import check  # noqa: E402
from rans_proof.problem import problem_of  # noqa: E402
from rans_proof.prove import ClosedLoop  # noqa: E402
from rans_proof.relaxation import Layer, Rounding, Zonotope, enclose, layer_tensors  # noqa: E402

from rans.base.errors import ConfigError  # noqa: E402

PROBLEM = """
name = "x1 rises from 0 to 3e5, whatever the network says"
period = 1.0
steps = 3
commands = 1
derivative = ["0", "1e5"]
start = {lower = [-0.1, 0.0], upper = [0.1, 0.0]}
keep.every = ["4e5 - x1"]
"""
STATES = np.array(list(itertools.product((-0.1, 0.0, 0.1), (0.0, 1e5, 2e5))))
"""Of flights at their decisions; the comparisons of both readers are around the starts, where x1 is 0."""
FORMS = (
    "m = MatMul(x, W); y = Mul(m, c)",
    "m = Div(x, d); y = MatMul(m, W)",
    "m = MatMul(x, W); n = Add(m, b); y = Sub(n, b)",
    "y = Gemm(x, W, b, alpha={alpha}, beta={beta})",
    "m = Gemm(x, V); t = Relu(m); y = Gemm(t, U, b)",
    "m = Gemm(x, V); t = Tanh(m); y = Gemm(t, U, b, alpha={alpha})",
)


def is_proved(content: bytes, text: str = PROBLEM) -> bool:
    problem = problem_of(text)
    try:
        layers = network.network_of(content, "net.onnx", problem.input_range())
    except ConfigError:
        return False
    loop = ClosedLoop(problem, layers, torch.device("cpu"))
    return bool(loop.margins(np.array([problem.lower]), np.array([problem.upper]))[0] > 0.0)


def is_accepted(content: bytes, text: str = PROBLEM) -> bool:
    table = {"format": 1, "network": hashlib.sha256(content).hexdigest(), "problem": text}
    table |= {"cells": [[[-0.1, 0.0], [0.1, 0.0]]], "margins": [1.0]}
    try:
        return check(json.dumps(table).encode(), content) > 0.0
    except Refused:
        return False


def is_finite(content: bytes, precision: Any) -> bool:
    options = runtime.SessionOptions()
    options.log_severity_level = 4
    try:
        session = runtime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception:  # a scale that it cannot keep
        return False
    answers = [session.run(None, {"x": x[None].astype(precision)})[0] for x in STATES]
    return bool(np.isfinite(answers).all())


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_what_is_no_number_in_flight_is_never_proved(precision, monkeypatch):
    """Weights from 1e-38 to 1e38 (or 1e-308 to 1e308), without the comparisons of the readers."""
    for module in (network, network_reader):
        monkeypatch.setattr(module, "_compare", lambda *_: None)
    random = np.random.default_rng(0)
    most = np.log10(np.finfo(precision).max)
    counts = np.zeros((2, 2), dtype=int)
    for form in FORMS * 8:
        # A part of the exponents, as products of two of the largest numbers are none.
        widest = most * random.choice((0.1, 1.0))

        def drawn(*shape, widest=widest):
            part = random.uniform(-1.0, 1.0, shape)
            # A third of them near the largest numbers, which some state of the flights makes too large.
            part = np.where(random.random(shape) < 0.3, 0.8 + 0.2 * np.abs(part), part)
            size = 10.0 ** (widest * part)
            sign = random.choice((-1.0, 1.0, 1.0, 0.0), shape)
            return (size * sign).astype(precision)

        ends = min(widest, 38.0) * random.uniform(-1.0, 1.0, 2)
        scales = dict(zip(("alpha", "beta"), (10.0**ends).tolist(), strict=True))
        shapes = {"W": (2, 1), "V": (2, 3), "U": (3, 1), "b": (1,), "c": (1,)}
        tables = {name: drawn(*shape) for name, shape in shapes.items()}
        divisor = np.abs(drawn(2)) + precision(10.0**-widest)
        content = graph(form.format(**scales), precision=precision, d=divisor, **tables)
        verdicts = is_proved(content), is_accepted(content)
        finite = is_finite(content, precision)
        assert finite or verdicts == (False, False), (form, scales, tables)
        counts[int(finite), int(all(verdicts))] += 1
    # Neither is without meaning: networks that give no number, and networks that both accept.
    assert counts[0, 0] > 4
    assert counts[1, 1] > 4


LARGE: dict[str, dict[str, Any]] = {
    "m = MatMul(x, W); y = Mul(m, c)": {"W": np.full((2, 1), 1e17), "c": np.full(1, 1e17)},
    "m = Div(x, d); y = MatMul(m, W)": {"d": np.full(2, 1e-20), "W": np.full((2, 1), 1e20)},
    "m = Gemm(x, V, b); n = Mul(m, c); y = Mul(n, c)": {
        "V": np.zeros((2, 1)),
        "b": np.full(1, 1e5),
        "c": np.full(1, 1e17),
    },
}
"""Chains of operations, none of which alone makes a number too large for single precision."""


@pytest.mark.parametrize("form", LARGE)
def test_sums_are_bounded_by_all_operations_of_a_chain_together(form, monkeypatch):
    for module in (network, network_reader):
        monkeypatch.setattr(module, "_compare", lambda *_: None)
    large = graph(form, **LARGE[form])
    assert not is_finite(large, np.float32)
    assert (is_proved(large), is_accepted(large)) == (False, False)
    # The square roots of the same numbers.
    roots: dict[str, Any] = {name: np.sqrt(x) for name, x in LARGE[form].items()}
    small = graph(form, **roots)
    assert is_finite(small, np.float32)
    assert (is_proved(small), is_accepted(small)) == (True, True)


def test_sums_are_bounded_with_all_that_was_added_before():
    """Three ones and a state of 1, times 2."""
    nodes = "l = Add(x, b); m = Add(l, b); n = Add(m, b); y = MatMul(n, W)"
    content = graph(nodes, shape=["N", 1], b=np.ones(1), W=np.full((1, 1), 2.0))
    ((*_, (*of_checker, _)),) = network_reader.layers_of(content, (-1.0,), (1.0,))
    (layer,) = network.network_of(content, "net.onnx", ([-1.0], [1.0]))
    assert layer.rounding is not None
    for factor, constant in (of_checker, layer.rounding.growth):
        assert factor + constant >= 8.0


@pytest.mark.parametrize("kind", ["relu", "sigmoid", "tanh"])
def test_what_a_layer_takes_is_bounded_by_what_the_layer_before_gives(kind):
    """From -3 to 3: up to 3, 0.9526 and 0.9951, all of which the next layer's sums may reach."""
    most = {"relu": 3.0, "sigmoid": 1.0 / (1.0 + np.exp(-3.0)), "tanh": np.tanh(3.0)}[kind]
    one, zero = np.ones((1, 1)), np.zeros(1)
    start = Zonotope(*(torch.tensor(x).double() for x in ([[0.0]], [[[3.0]]], [[0.0]])))
    for limit, is_number in ((3.99 * most, False), (6.0 * most, True)):
        sums = Rounding(0.0 * one, zero, 0, 0.0, (4.0, 0.0), limit)
        layers = [Layer(one, zero, kind), Layer(one, zero, "", sums)]
        planes = enclose(layer_tensors(layers, torch.device("cpu")), start)
        assert bool(planes.error.isfinite().all()) == is_number
        in_balls = matrix(one), matrix(0.0 * one)
        second = (*in_balls, "", None, (arb(4), arb(0), arb(limit)))
        with nullcontext() if is_number else pytest.raises(Refused):
            network_enclosure(
                [(*in_balls, kind.capitalize()), second], in_balls[1], 3 * in_balls[0]
            )
