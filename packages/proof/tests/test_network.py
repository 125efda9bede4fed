"""Prover and checker read a network as ONNX Runtime computes it, or refuse it.

Each has two lines of defence, its reader and a comparison, and each line is tested without the other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from rans_proof import network

from rans import ConfigError
from tests.support.graphs import WEIGHT, forged, graph, ordinary, step

from .planted import ERRORS, planted

pytest.importorskip("onnx")
pytest.importorskip("flint")
runtime = pytest.importorskip("onnxruntime")

from flint import arb_mat  # noqa: E402
from rans_proof import network_reader as checker  # noqa: E402
from rans_proof.balls import Refused, matrix, network_enclosure  # noqa: E402

STATES = 3.0 * np.random.default_rng(3).normal(size=(40, 2)).astype(np.float32)
READERS: dict[str, tuple[Any, Callable[[Any, bytes], np.ndarray], type[Exception]]] = {}


def of_runtime(content: bytes) -> np.ndarray:
    """What ONNX Runtime answers to the states, one at a time."""
    session = runtime.InferenceSession(content, providers=["CPUExecutionProvider"])
    (taken,) = [entry for entry in session.get_inputs() if entry.name == "x"]
    shape = [axis if isinstance(axis, int) else 1 for axis in taken.shape]
    states = STATES.astype(np.float64 if taken.type == "tensor(double)" else np.float32)
    return np.stack([session.run(None, {"x": x.reshape(shape)})[0].ravel() for x in states])


def of_prover(module: Any, content: bytes) -> np.ndarray:
    layers = module.network_of(content, "net.onnx")
    assert all(layer.activation for layer in layers[:-1])
    return module.apply(layers, STATES.astype(float))


def of_checker(module: Any, content: bytes) -> np.ndarray:
    bends: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "": lambda z: z,
        "Tanh": np.tanh,
        "Relu": lambda z: z * (z > 0),
        "Sigmoid": lambda z: 1.0 / (1.0 + np.exp(-z)),
    }
    x = STATES.astype(float).T
    layers = module.layers_of.__wrapped__(content, (-1.0, -1.0), (1.0, 1.0))
    assert all(layer.kind for layer in layers[:-1])  # enclosures end at a layer that does not bend
    for layer in layers:
        table, shift = (np.array(m.tolist(), dtype=float) for m in (layer.weight, layer.bias))
        x = bends[layer.kind](table @ x + shift)
    return x.T


READERS["prover"] = network, of_prover, ConfigError
READERS["checker"] = checker, of_checker, Refused


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("form", ordinary())
def test_ordinary_graphs_are_read_as_they_run(form, reader, monkeypatch):
    module, answers, _ = READERS[reader]
    content = ordinary()[form]
    true = of_runtime(content)
    # Single precision errs by 1e-7 of sums below 100.
    np.testing.assert_allclose(answers(module, content), true, atol=2e-5)
    monkeypatch.setattr(module, "_compare", lambda *_: None)
    np.testing.assert_allclose(answers(module, content), true, atol=2e-5)


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("form", forged())
def test_forged_graphs_are_refused_by_the_reader_alone(form, reader, monkeypatch, tmp_path):
    module, answers, refusal = READERS[reader]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "weights.bin").write_bytes(WEIGHT.tobytes())  # of the graph that keeps them there
    monkeypatch.setattr(module, "_compare", lambda *_: None)
    with pytest.raises(refusal) as caught:
        answers(module, forged()[form])
    assert "\n" not in str(caught.value)


def cancelling(kind: str) -> bytes:
    """A network of sums whose terms are 2,000 times as large as they are, and err by some 1e-4."""
    random = np.random.default_rng(4)
    return graph(
        f"m = Gemm(x, c, d); n = Sub(m, e); t = {kind}(n); y = Gemm(t, f, g)"
        if kind
        else "m = Gemm(x, c, d); y = Sub(m, e)",
        c=np.round(1000.0 * random.normal(size=(2, 30))),
        d=1000.0 + random.normal(size=30),
        e=np.full(30, 1000.0),
        f=random.normal(size=(30, 2)),
        g=np.zeros(2),
    )


@pytest.mark.parametrize(
    ("reader", "form", "old", "new"),
    [(reader, *error) for reader in READERS for error in ERRORS[f"misread_by_{reader}"]],
)
def test_what_is_misread_is_refused_by_the_comparison(reader, form, old, new):
    module, answers, refusal = READERS[reader]
    wrong = planted([module.__name__], (module.__name__, old, new))[module.__name__]
    graphs = ordinary() | {"sums that cancel": cancelling("Tanh")}
    with pytest.raises(refusal, match=r"ONNX Runtime computes|onnx\.reference than"):
        answers(wrong, graphs[form])


@pytest.mark.parametrize("reader", READERS)
def test_weights_too_large_for_single_precision_are_refused(reader):
    """The exact network answers W x; in single precision 1e9 + 1 is 1e9."""
    module, answers, refusal = READERS[reader]
    content = graph(
        [step("Gemm", "x W c", "m"), step("Add", "m d", "n"), step("Tanh", "n", "y")],
        c=np.full(2, 1e9),
        d=np.full(2, -1e9),
    )
    with pytest.raises(refusal):
        answers(module, content)


@pytest.mark.parametrize("kind", ["Tanh", "Sigmoid", "Relu", ""])
def test_planes_hold_what_single_precision_answers(kind):
    """The checker's planes do; the prover compares its own with ONNX Runtime whenever it reads a file."""
    content = cancelling(kind)
    network.network_of(content, "net.onnx")
    states = (1e-3 * STATES[:20]).astype(np.float32)
    session = runtime.InferenceSession(content, providers=["CPUExecutionProvider"])
    (answers,) = session.run(None, {"x": states})
    layers = checker.layers_of.__wrapped__(content, (-1.0, -1.0), (1.0, 1.0))
    excess = []
    for state, answer in zip(states.astype(float), answers, strict=True):
        planes = network_enclosure(layers, matrix(state[:, None]), arb_mat(2, 0))
        gain, offset = (np.array(m.tolist(), dtype=float) for m in planes[:2])
        error = np.array([float(x.upper()) for x in planes[2]])
        excess.append(np.abs(answer - gain @ state - offset[:, 0]) / error)
    # No term errs by its bound, and hundreds are summed.
    assert 0.003 <= np.max(excess) <= 1.0


def test_networks_of_other_sizes_than_the_starts_are_refused():
    content = ordinary()["general product"]
    ends = (-1.0,) * 3, (1.0,) * 3
    with pytest.raises(ConfigError, match="3 states"):
        network.network_of(content, "net.onnx", ends)
    with pytest.raises(Refused, match="3 states"):
        checker.layers_of(content, *ends)


@pytest.mark.parametrize("content", [b"", b"junk", b"\x08\x07" * 40, bytes(range(256))])
def test_junk_is_a_sentence(content):
    for module, answers, refusal in READERS.values():
        with pytest.raises(refusal) as caught:
            answers(module, content)
        assert "\n" not in str(caught.value)
