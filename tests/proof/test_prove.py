"""Proofs against simulated flights, ball arithmetic and planted errors."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rans.cli import main
from rans.errors import ConfigError
from rans.proof.certificate import write_certificate
from rans.proof.network import Layer, apply, read_network
from rans.proof.problem import Avoid, Problem, Within, problem_of, read_problem
from rans.proof.prove import ClosedLoop, lowest_margins, prove
from rans.proof.relaxation import TorchLayer, Zonotope, enclose, parallel_lines
from tests.support.processes import ROOT

onnx = pytest.importorskip("onnx")

DOCKING = """
name = "small docking"
period = 1.0
steps = 8
commands = 2
derivative = [
  "x2", "x3",
  "0.000003 * x0 + 0.002 * x3 + 0.08 * u0",
  "-0.002 * x2 + 0.08 * u1",
]
[start]
lower = [70.0, 70.0, -0.1, -0.1]
upper = [90.0, 90.0, 0.1, 0.1]
[keep.speed_limit]
position = [0, 1]
velocity = [2, 3]
base = 0.2
slope = 0.002
"""
SPINNING = """
name = "spin of an asymmetric body"
period = 0.1
steps = 10
commands = 3
derivative = ["0.25 * (u0 + x1 * x2)", "0.5 * (u1 - 3 * x0 * x2)", "u2 + 2 * x0 * x1"]
[start]
lower = [0.30, -0.20, 0.10]
upper = [0.31, -0.19, 0.11]
[keep.avoid]
lower = [-1.0, 0.5, -1.0]
upper = [1.0, 1.0, 1.0]
"""
INSIDE = (
    SPINNING.split("[keep")[0]
    + """
[keep.within]
lower = [0.0, -1.0, 0.0]
upper = [0.9, 0.4, 2.4]
"""
)
HOLDING = """
name = "hold outside of a ball"
period = 5.0
steps = 12
commands = 2
derivative = ["x2", "x3", "0.002 * x3 + 0.02 * u0", "-0.002 * x2 + 0.02 * u1"]
[start]
lower = [-20.0, -90.0, -0.3, 0.1]
upper = [20.0, -80.0, 0.3, 0.3]
[keep.keep_out]
position = [0, 1]
radius = 50.0
"""


def layers(
    sizes: Sequence[int], seed: int, activation: str = "tanh", scale: float = 1.0
) -> list[Layer]:
    random = np.random.default_rng(seed)
    return [
        Layer(
            scale * random.normal(size=(b, a)) / np.sqrt(a), 0.3 * random.normal(size=b), activation
        )
        for a, b in itertools.pairwise(sizes)
    ]


def damping(inputs: int, velocity: Sequence[int], seed: int) -> list[Layer]:
    """A network that brakes, roughly: u = tanh(-6 v + a little of the rest)."""
    first, last = layers([inputs, 16, len(velocity)], seed, scale=0.2)
    weight = 0.002 * first.weight
    for k, i in enumerate(velocity):
        weight[k] = 0.0
        weight[k, i] = 1.0
    out = 0.01 * last.weight
    for k in range(len(velocity)):
        out[k, k] = -6.0
    return [Layer(weight, 0.0 * first.bias, "tanh"), Layer(out, 0.0 * last.bias, "tanh")]


def written(network: Sequence[Layer], file: Path) -> Path:
    """The network as ONNX's own helpers write it."""
    from onnx import TensorProto, helper, numpy_helper

    nodes, tables, name = [], [], "x"
    for k, (weight, bias, activation) in enumerate(network):
        tables += [
            numpy_helper.from_array(weight.T.astype(np.float32), f"w{k}"),
            numpy_helper.from_array(bias.astype(np.float32), f"b{k}"),
        ]
        nodes += [
            helper.make_node("MatMul", [name, f"w{k}"], [f"m{k}"]),
            helper.make_node("Add", [f"m{k}", f"b{k}"], [f"a{k}"]),
            helper.make_node(activation.capitalize(), [f"a{k}"], [f"h{k}"]),
        ]
        name = f"h{k}"
    ends = [
        helper.make_tensor_value_info(one, TensorProto.FLOAT, ["N", width])
        for one, width in (("x", network[0].weight.shape[1]), (name, len(network[-1].bias)))
    ]
    graph = helper.make_graph(nodes, "net", ends[:1], ends[1:], tables)
    model = helper.make_model(graph, ir_version=8, opset_imports=[helper.make_opsetid("", 17)])
    file.write_bytes(model.SerializeToString())
    return file


@given(
    st.floats(-30.0, 30.0),
    st.one_of(st.just(0.0), st.floats(1e-12, 40.0)),
    st.sampled_from(["tanh", "sigmoid", "relu"]),
)
@settings(max_examples=200, deadline=None)
def test_an_activation_lies_between_its_lines(low: float, width: float, kind: str) -> None:
    ends = (
        torch.tensor([low], dtype=torch.float64),
        torch.tensor([low + width], dtype=torch.float64),
    )
    slope, offset, error = (float(x) for x in parallel_lines(*ends, kind))
    z = np.linspace(low, low + width, 400)
    bends = {
        "tanh": np.tanh,
        "sigmoid": lambda z: 1.0 / (1.0 + np.exp(-z)),
        "relu": lambda z: z * (z > 0),
    }
    y = bends[kind](z)
    # The test's own values have rounding errors of a few units in the last place.
    assert (np.abs(y - slope * z - offset) <= error + 4e-16 * (1.0 + np.abs(z).max())).all()
    assert error <= (1.0 if kind != "relu" else 0.125 * width + 1e-9)


@pytest.mark.parametrize("activation", ["tanh", "sigmoid", "relu"])
@pytest.mark.parametrize("sizes", [(3, 2), (3, 8, 2), (3, 8, 9, 2), (3, 6, 7, 8, 2)])
def test_a_network_lies_between_its_planes(activation: str, sizes: tuple[int, ...]) -> None:
    """Random points of random zonotopes, extreme ones among them."""
    network = layers(sizes, 1, activation, 2.0)
    random = np.random.default_rng(2)
    centre = random.normal(size=(5, 3))
    generators = 0.2 * random.normal(size=(5, 3, 4))
    box = 0.1 * random.random((5, 3))
    tensors = [
        TorchLayer(torch.tensor(one.weight), torch.tensor(one.bias), one.activation)
        for one in network
    ]
    planes = enclose(tensors, Zonotope(*map(torch.tensor, (centre, generators, box))))
    for k in range(5):
        s = random.uniform(-1, 1, (2000, 4))
        t = random.uniform(-1, 1, (2000, 3))
        s[::2] = np.sign(s[::2])
        t[::2] = np.sign(t[::2])
        x = centre[k] + s @ generators[k].T + t * box[k]
        linear = x @ planes.gain[k].numpy().T + planes.offset[k].numpy()
        assert (np.abs(apply(network, x) - linear) <= planes.error[k].numpy()).all()
    assert float(planes.error.max()) < 2.0


@pytest.mark.parametrize(
    ("text", "network"),
    [
        (DOCKING, damping(4, (2, 3), 3)),
        (DOCKING, layers([4, 8, 2], 5, scale=0.01)),
        (SPINNING, layers([3, 8, 8, 3], 4, "sigmoid")),
        (INSIDE, layers([3, 8, 8, 3], 4, "sigmoid")),
        (HOLDING, damping(4, (2, 3), 3)),
        (HOLDING, layers([4, 8, 2], 5, "relu", scale=0.01)),
    ],
    ids=["brakes", "pushes", "spins", "stays in", "stays out", "drifts"],
)
def test_no_flight_has_less_than_its_cells_margin(text: str, network: list[Layer]) -> None:
    """Margins of flights by Runge-Kutta, whose own error is far below the distance seen here."""
    problem = problem_of(text)
    low, high = np.array([problem.lower]), np.array([problem.upper])
    random = np.random.default_rng(0)
    loop = ClosedLoop(problem, network, torch.device("cpu"))
    for parts in (1, 4):
        half = (high - low) / 2.0 / parts
        middle = (low + high) / 2.0
        cell = middle - half, middle + half
        margin = loop.margins(*cell)[0][0]
        start = random.uniform(*cell, (500, problem.states))
        start[::3] = np.where(random.random(start[::3].shape) < 0.5, *cell)
        assert margin <= lowest_margins(problem, network, start).min()


def test_between_instants_too() -> None:
    """A swing over one long period, whose ends are outside the box that it enters."""
    problem = problem_of(
        'name = "swing"\nperiod = 3.0\nsteps = 1\ncommands = 1\n'
        'derivative = ["x1", "-1 * x0 + 0 * u0"]\n'
        "[start]\nlower = [0.0, 1.0]\nupper = [0.0, 1.0]\n"
        "[keep.avoid]\nlower = [0.9, -2.0]\nupper = [2.0, 2.0]\n"
    )
    # x0 = sin t: 0 at the start and 0.14 at the end, and 1 in between, which is inside the box.
    loop = ClosedLoop(problem, layers([2, 2, 1], 0), torch.device("cpu"))
    assert loop.margins(np.array([[0.0, 1.0]]), np.array([[0.0, 1.0]]))[0][0] < 0.0


SETTLING = """
name = "a mass on a line comes to rest"
period = 0.5
steps = 40
commands = 1
derivative = ["x1", "u0"]
[start]
lower = [-1.0, -0.2]
upper = [1.0, 0.2]
[keep.avoid]
lower = [2.0, -9.0]
upper = [9.0, 9.0]
"""


def test_flights_end_in_a_box(tmp_path: Path) -> None:
    """u = tanh(-0.3 x - v) brings x = 1 to rest: 20 s later it is near 0, and 2 s later it is not."""
    network = written([Layer(np.array([[-0.3, -1.0]]), np.zeros(1), "tanh")], tmp_path / "net.onnx")
    layers = read_network(network)
    end = "[end]\nlower = [-0.5, -0.1]\nupper = [0.5, 0.1]\n"
    problem = problem_of(SETTLING + end)
    proof = prove(problem, layers)
    assert proof.is_whole
    assert problem.end is not None
    ends = np.array([[-0.5, 0.0], [0.3, 0.05], [0.0, -0.11]])
    np.testing.assert_allclose(problem.end.margins(ends), [0.0, 0.05, -0.01], atol=1e-12)
    # The checker finds the same, and refuses the same cells for a box that flights miss, and for a shorter time.
    write_certificate(proof, network, tmp_path / "end.json")
    content, file = (tmp_path / "end.json").read_text(), network.read_bytes()
    assert verdict(content.encode(), file) == pytest.approx(proof.margins.min(), abs=1e-9)
    from rans.proof.balls import Refused

    for old, new in (("-0.5, -0.1", "0.2, -0.1"), ("steps = 40", "steps = 4")):
        assert old in content
        with pytest.raises(Refused, match="margin"):
            verdict(content.replace(old, new).encode(), file)
    assert not prove(problem_of((SETTLING + end).replace("= 40", "= 4")), layers).is_whole


def test_the_hold_agent_stays_for_ever() -> None:
    """The box in which its flights end is one that it comes back to, so that the ball is never entered."""
    folder = ROOT / "examples/proofs"
    far, near = (read_problem(folder / f"hold-agent{name}.toml") for name in ("", "-near"))
    assert far.end == near.end == Within(near.lower, near.upper)
    assert far.keep == near.keep
    assert far.derivative == near.derivative
    assert far.period == near.period
    assert prove(near, read_network(folder / "hold-agent.onnx")).is_whole


def test_what_is_false_ends_with_a_flight_that_breaks_it() -> None:
    problem = problem_of(DOCKING.replace("base = 0.2", "base = -0.01"))
    push = [Layer(np.zeros((2, 4)), np.array([5.0, 5.0]), "tanh")]
    proof = prove(problem, push)
    assert proof.counterexample is not None
    assert lowest_margins(problem, push, proof.counterexample[None])[0] < 0.0
    assert not proof.is_whole


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("proof")
    network = written(damping(4, (2, 3), 3), folder / "net.onnx")
    (folder / "docking.toml").write_text(DOCKING)
    arguments = ["prove", str(network), "--problem", str(folder / "docking.toml")]
    assert main([*arguments, "--cells", "2"]) == 0
    return network, folder / "docking.certificate.json"


def verdict(certificate: bytes, network: bytes) -> float:
    pytest.importorskip("flint")
    from rans.proof.check import check

    return check(certificate, network)


def test_the_checker_agrees(
    certificate: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    network, file = certificate
    table = json.loads(file.read_bytes())
    found = verdict(file.read_bytes(), network.read_bytes())
    # Both bound the same flights; polygons of 64 and of 48 sides differ by 0.1 % of a speed of 0.4 m/s.
    assert found == pytest.approx(min(table["margins"]), abs=1e-3)
    assert main(["prove", str(network), "--check", str(file), "--workers", "1"]) == 0
    assert "Accepted" in capsys.readouterr().out


def _changed_network(content: bytes, table: dict[str, Any]) -> bytes:
    model = onnx.load_model_from_string(content)
    for one in model.graph.initializer:
        if one.name == "b0":
            values = onnx.numpy_helper.to_array(one).copy()
            values[0] += 1e-6
            one.CopyFrom(onnx.numpy_helper.from_array(values, "b0"))
    return model.SerializeToString()


@pytest.mark.parametrize(
    "error",
    [
        "bias",
        "missing",
        "smaller",
        "larger start",
        "false",
        "faster",
        "infinite",
        "huge",
        "no time",
    ],
)
def test_planted_errors_are_refused(error: str, certificate: tuple[Path, Path]) -> None:
    pytest.importorskip("flint")
    from rans.proof.check import Refused

    network, file = certificate
    content = network.read_bytes()
    table = json.loads(file.read_bytes())
    match error:
        case "bias":
            content = _changed_network(content, table)
        case "missing":
            del table["cells"][3]
        case "smaller":
            table["cells"][0][1][2] = float(np.nextafter(table["cells"][0][1][2], -1.0))
        case "larger start":
            table["problem"] = table["problem"].replace("upper = [90.0,", "upper = [90.000001,")
        case "false":  # a property that does not hold
            table["problem"] = table["problem"].replace("base = 0.2", "base = -0.2")
        case (
            "infinite" | "huge"
        ):  # one cell that covers everything; sums of infinities are no numbers
            size = float("inf") if error == "infinite" else 1e200
            table["cells"] = [[[-size] * 4, [size] * 4]]
        case "no time":
            table["problem"] = table["problem"].replace("steps = 8", "steps = 0")
        case "faster":  # a set that is too large for its margin
            table["problem"] = table["problem"].replace("0.1, 0.1]", "0.9, 0.9]")
            table["cells"] = [[low, [*high[:2], 0.9, 0.9]] for low, high in table["cells"]]
    with pytest.raises(Refused):
        verdict(json.dumps(table).encode(), content)


@pytest.mark.parametrize(("radius", "passes"), [(75.0, True), (79.0, False)])
def test_the_checker_knows_the_ball(radius: float, passes: bool, tmp_path: Path) -> None:
    """Flights brake from 0.3 m/s, 80 m away: at the nearest they come to 77 m."""
    network = written(damping(4, (2, 3), 3), tmp_path / "net.onnx")
    problem = problem_of(HOLDING.replace("50.0", "70.0"))
    write_certificate(prove(problem, read_network(network)), network, tmp_path / "ball.json")
    table = json.loads((tmp_path / "ball.json").read_text())
    content = json.dumps(table).replace("radius = 70.0", f"radius = {radius}").encode()
    if passes:
        assert verdict(content, network.read_bytes()) > 0.0
        return
    from rans.proof.balls import Refused

    with pytest.raises(Refused, match="margin"):
        verdict(content, network.read_bytes())


def test_the_checker_agrees_about_rectifiers(tmp_path: Path) -> None:
    """Rectifiers below a last layer of tanh, whose commands push a craft at the limit of its speed."""
    hidden, last = layers([4, 8, 2], 5, scale=0.05)
    both = [Layer(hidden.weight, hidden.bias, "relu"), last]
    network = written(both, tmp_path / "net.onnx")
    proof = prove(problem_of(HOLDING), read_network(network))
    assert proof.is_whole
    write_certificate(proof, network, tmp_path / "ball.json")
    found = verdict((tmp_path / "ball.json").read_bytes(), network.read_bytes())
    assert found == pytest.approx(proof.margins.min(), rel=1e-6)


@pytest.mark.parametrize("activation", ["sigmoid", "relu"])
def test_reading_follows_onnx(activation: str, tmp_path: Path) -> None:
    runtime = pytest.importorskip("onnxruntime")
    network = layers([4, 7, 5, 2], 8, activation)
    file = written(network, tmp_path / "net.onnx")
    session = runtime.InferenceSession(str(file))
    x = np.random.default_rng(1).normal(size=(50, 4)).astype(np.float32)
    (expected,) = session.run(None, {"x": x})
    # The session computes in single precision.
    np.testing.assert_allclose(apply(read_network(file), x), expected, atol=2e-6)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('"x2", "x3"', '"x2", "__import__(0)"', "no polynomial"),
        ('"x2", "x3"', '"x2", "x3 ** 99"', "no polynomial"),
        ('"x2", "x3"', '"x2", "x9"', "no polynomial"),
        ("steps = 8", "steps = 0", "steps must be"),
        ("period = 1.0", "period = 0.0", "period must be"),
        ("period = 1.0", "period = nan", "period must be"),
        ("upper = [90.0", "upper = [60.0", "must not be above"),
        ("slope = 0.002", "slope = -0.002", "must be >= 0"),
        ("steps = 8", "steps = 8\nhorizon = 3", "must have the keys"),
    ],
)
def test_a_wrong_problem_is_a_sentence(old: str, new: str, sentence: str) -> None:
    assert old in DOCKING
    with pytest.raises(ConfigError, match=sentence):
        problem_of(DOCKING.replace(old, new))


@pytest.mark.parametrize(("name", "parts"), [("docking-agent", 4), ("hold-agent", 8)])
def test_the_agents_of_the_page_keep_their_property(name: str, parts: int) -> None:
    """A random cell, 30 periods long, and flights from it, of which none has less than its margin."""
    folder = ROOT / "examples/proofs"
    problem = replace(read_problem(folder / f"{name}.toml"), steps=30, end=None)
    network = read_network(folder / f"{name}.onnx")
    low, high = np.array(problem.lower), np.array(problem.upper)
    random = np.random.default_rng(5)
    corner = random.integers(0, parts, (1, problem.states)) / parts
    ends = low + (high - low) * corner, low + (high - low) * (corner + 1.0 / parts)
    margins = ClosedLoop(problem, network, torch.device("cpu")).margins(*ends)[0]
    assert margins.min() > 0.0
    for margin, begin, end in zip(margins, *ends, strict=True):
        start = random.uniform(begin, end, (50, problem.states))
        assert margin <= lowest_margins(problem, network, start).min()


def test_the_pose_agent_stays_for_ever() -> None:
    """It comes back to the box of its starts, and the limits of 5 cm and 5 degrees are around it."""
    problem = read_problem(ROOT / "examples/proofs/pose-agent.toml")
    network = read_network(ROOT / "examples/proofs/pose-agent.onnx")
    assert problem.end == Within(problem.lower, problem.upper)
    assert isinstance(problem.keep, Within)
    assert np.linalg.norm(problem.keep.upper[:2]) <= 0.05
    assert problem.keep.upper[4] <= np.deg2rad(5.0)
    start = np.random.default_rng(4).uniform(problem.lower, problem.upper, (200, 6))
    least = lowest_margins(problem, network, start).min()
    assert least > 0.0
    # A part of the proof; all of it takes two seconds.
    short = replace(problem, steps=4, end=None)
    loop = ClosedLoop(short, network, torch.device("cpu"))
    margin = loop.margins(np.array([problem.lower]), np.array([problem.upper]))[0][0]
    assert 0.0 < margin <= lowest_margins(short, network, start).min()


@pytest.mark.slow
def test_the_pose_agent_is_proved() -> None:
    problem = read_problem(ROOT / "examples/proofs/pose-agent.toml")
    assert prove(problem, read_network(ROOT / "examples/proofs/pose-agent.onnx")).is_whole


def test_powers_of_balls_round_zero() -> None:
    """Spins and heading near zero: products and squares of them are numbers."""
    flint = pytest.importorskip("flint")
    from rans.proof.balls import polynomial, value_at

    ball = flint.arb(0, 0.5)
    value = value_at(polynomial("x0 * x0 * x1 - 2 * x0", 2, 2), [ball, flint.arb(3)])
    assert value.contains(0)
    assert 1.0 <= float(value.upper()) < 2.0


def test_the_hold_agent_from_ahead_is_refuted() -> None:
    """Its guidance knows nothing of the ball, which is then on its way."""
    folder = ROOT / "examples/proofs"
    problem = read_problem(folder / "hold-agent.toml")
    ahead = replace(
        problem, steps=60, end=None, lower=(-5, 150, -5, 0, 0, 0), upper=(5, 160, 5, 0, 0, 0)
    )
    network = read_network(folder / "hold-agent.onnx")
    proof = prove(ahead, network)
    assert proof.counterexample is not None
    assert lowest_margins(ahead, network, proof.counterexample[None])[0] < 0.0


@pytest.mark.slow
def test_flights_of_the_docking_agent_keep_the_limit() -> None:
    folder = ROOT / "examples/proofs"
    problem = read_problem(folder / "docking-agent.toml")
    network = read_network(folder / "docking-agent.onnx")
    assert prove(problem, network, first=[4, 4, 4, 4]).is_whole
    start = np.random.default_rng(6).uniform(problem.lower, problem.upper, (20_000, 4))
    assert lowest_margins(problem, network, start).min() > 0.0


def test_the_shipped_problems_are_read() -> None:
    docking, attitude = (
        read_problem(ROOT / "examples/proofs" / name) for name in ("docking.toml", "attitude.toml")
    )
    assert docking.linear() is not None
    assert attitude.linear() is None
    assert isinstance(attitude.keep, Avoid)
    assert isinstance(docking, Problem)
