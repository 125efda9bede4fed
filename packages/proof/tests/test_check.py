"""The check of certificates in ball arithmetic, which planted errors must not pass."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_proof.certificate import write_certificate
from rans_proof.network import Layer, read_network
from rans_proof.problem import problem_of
from rans_proof.prove import prove

from rans.cli import main
from tests.support.small_networks import damping, layers, written

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
    write_certificate(proof, network.read_bytes(), tmp_path / "end.json")
    content, file = (tmp_path / "end.json").read_text(), network.read_bytes()
    assert verdict(content.encode(), file) == pytest.approx(proof.margins.min(), abs=1e-9)
    from rans_proof.balls import Refused

    for old, new in (("-0.5, -0.1", "0.2, -0.1"), ("steps = 40", "steps = 4")):
        assert old in content
        with pytest.raises(Refused, match="margin"):
            verdict(content.replace(old, new).encode(), file)
    assert not prove(problem_of((SETTLING + end).replace("= 40", "= 4")), layers).is_whole


def test_a_state_that_never_changes_needs_no_margin_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An unknown push of up to 0.01 m/s^2 is a state of rate 0: it ends where it starts."""
    network = written(
        [Layer(np.array([[-0.3, -1.0, 0.0]]), np.zeros(1), "tanh")], tmp_path / "net.onnx"
    )
    text = (
        SETTLING.replace('"u0"', '"u0 + x2", "0"')
        .replace("steps = 40", "steps = 24")
        .replace("-0.2]", "-0.2, -0.01]")
        .replace("0.2]\n", "0.2, 0.01]\n")
        .replace("-9.0]", "-9.0, -9.0]")
        .replace("9.0]\n[end", "9.0, 9.0]\n[end")
        + "[end]\nlower = [-0.5, -0.1, -0.01]\nupper = [0.5, 0.1, 0.01]\n"
    ).replace("upper = [9.0, 9.0]", "upper = [9.0, 9.0, 9.0]")
    layers, content = read_network(network), network.read_bytes()
    proof = prove(problem_of(text), layers)
    assert proof.is_whole
    write_certificate(proof, content, tmp_path / "push.json")
    assert verdict((tmp_path / "push.json").read_bytes(), content) > 0.0
    # It is not in a narrower box, and a state that changes is no such state.
    monkeypatch.setattr("rans_proof.check._DEPTH", 0)
    from rans_proof.balls import Refused

    for old, new in (("0.1, 0.01]", "0.1, 0.005]"), ('"0"', '"0.001 * x2"')):
        assert old in text
        table = json.loads((tmp_path / "push.json").read_text())
        table["problem"] = table["problem"].replace(old, new)
        with pytest.raises(Refused):
            verdict(json.dumps(table).encode(), content)


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("proof")
    network = written(damping(4, (2, 3), 3), folder / "net.onnx")
    (folder / "docking.toml").write_text(DOCKING)
    arguments = ["prove", str(network), "--problem", str(folder / "docking.toml")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rans_proof.command._CELLS", 2)  # 16 cells are checked in a second
        assert main(arguments) == 0
    return network, folder / "docking.certificate.json"


def verdict(certificate: bytes, network: bytes) -> float:
    pytest.importorskip("flint")
    from rans_proof.check import check

    return check(certificate, network)


def test_the_checker_agrees(certificate: tuple[Path, Path]) -> None:
    network, file = certificate
    table = json.loads(file.read_bytes())
    found = verdict(file.read_bytes(), network.read_bytes())
    # Both bound the same flights; polygons of 64 and of 48 sides differ by 0.1 % of a speed of 0.4 m/s.
    assert found == pytest.approx(min(table["margins"]), abs=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        ("base = 0.2", "base = 0.21", "keep"),
        ("steps = 8", "steps = 7", "steps"),
        ("upper = [90.0", "upper = [89.0", "start"),
        ("0.002 * x3", "0.002 * x2", "derivative"),
        pytest.param("steps", "# a comment\nsteps", "", marks=pytest.mark.slow),  # is the same
    ],
)
def test_a_certificate_of_another_problem_is_refused(
    old: str,
    new: str,
    name: str,
    certificate: tuple[Path, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("flint")
    network, file = certificate
    problem = tmp_path / "other.toml"
    assert old in DOCKING
    problem.write_text(DOCKING.replace(old, new))
    arguments = ["prove", str(network), "--check", str(file), "--problem", str(problem)]
    assert main(arguments) == bool(name)
    printed = capsys.readouterr().out
    if name:
        assert printed.startswith("Refused: ")
        assert printed.strip().endswith(f"by {name}.")
        return
    assert printed.startswith("Accepted: ")
    # What is proved, from the certificate: start, time and limit.
    for text in (
        "x0 in [70, 90]",
        "x3 in [-0.1, 0.1]",
        "to 8 s",
        "|(x2, x3)| <= 0.2 + 0.002 |(x0, x1)|",
    ):
        assert text in " ".join(printed.split())


def test_the_command_judges_a_certificate_without_cells(
    certificate: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("flint")
    network, file = certificate
    table = {**json.loads(file.read_bytes()), "cells": []}
    (tmp_path / "empty.json").write_text(json.dumps(table))
    check = ["--check", str(tmp_path / "empty.json")]
    assert main(["prove", str(network), *check]) == 1
    assert capsys.readouterr().out.startswith("Refused: ")


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
        "no cells",
        "falling limit",
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
    from rans_proof.balls import Refused

    network, file = certificate
    content = network.read_bytes()
    table = json.loads(file.read_bytes())
    match error:
        case "bias":
            content = _changed_network(content, table)
        case "missing":
            del table["cells"][3]
        case "no cells":
            table["cells"] = []
        case "falling limit":  # distances are bounded from below, which serves limits that grow
            table["problem"] = table["problem"].replace(
                "base = 0.2\nslope = 0.002", "base = 10.0\nslope = -0.002"
            )
            assert "-0.002\n" in table["problem"]
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
    write_certificate(
        prove(problem, read_network(network)), network.read_bytes(), tmp_path / "ball.json"
    )
    table = json.loads((tmp_path / "ball.json").read_text())
    content = json.dumps(table).replace("radius = 70.0", f"radius = {radius}").encode()
    if passes:
        assert verdict(content, network.read_bytes()) > 0.0
        return
    from rans_proof.balls import Refused

    with pytest.raises(Refused, match="margin"):
        verdict(content, network.read_bytes())


def test_a_flight_that_refutes_is_flown_again(
    certificate: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A limit that the fastest starts break at once; another start, network or flight is refused."""
    pytest.importorskip("flint")
    network = certificate[0]
    problem, file = tmp_path / "false.toml", tmp_path / "flight.json"
    problem.write_text(DOCKING.replace("base = 0.2", "base = -0.1"))
    arguments = ["prove", str(network), "--problem", str(problem), "--output", str(file)]
    assert main(arguments) == 1
    assert capsys.readouterr().out.startswith("False: ")
    table = json.loads(file.read_text())
    start = np.array(table["flight"][0])
    broken = np.linalg.norm(start[2:]) - (-0.1 + 0.002 * np.linalg.norm(start[:2]))
    assert -verdict(file.read_bytes(), network.read_bytes()) >= broken - 1e-9 > -1e-9
    assert main(["prove", str(network), "--check", str(file)]) == 0
    assert "breaks the property" in capsys.readouterr().out
    from rans_proof.balls import Refused

    for old, new in (("base = -0.1", "base = 0.2"), ("0.08 * u1", "0.09 * u1")):
        assert old in table["problem"]
        forged = {**table, "problem": table["problem"].replace(old, new)}
        with pytest.raises(Refused, match="flight"):
            verdict(json.dumps(forged).encode(), network.read_bytes())


@pytest.mark.parametrize(("off", "is_accepted"), [(0.0, True), (2e-4, True), (2e-2, False)])
def test_a_flight_that_refutes_may_differ_by_rounding(
    off: float, is_accepted: bool, tmp_path: Path
) -> None:
    """u = tanh(((10^4 + x) - (10^4 - x)) / 2) in single precision, whose numbers near 10^4 are 0.001 apart.

    Rounding changes u by up to 0.0005 and the velocity after 0.5 s by 0.00025, which is more than the 1e-6 that a
    flight in double precision may be off.
    """
    sums = Layer(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.full(2, 1e4), "relu")
    network = written(
        [sums, Layer(np.array([[0.5, -0.5]]), np.zeros(1), "tanh")], tmp_path / "net.onnx"
    )
    lower, upper = "lower = [-1.0, -0.2]\nupper", "upper = [1.0, 0.2]"
    fast = SETTLING.replace(lower, "lower = [1.0, 0.2]\nupper").replace(upper, "upper = [1.1, 0.3]")
    assert fast.count("0.2]") == 1
    proof = prove(problem_of(fast), read_network(network))
    assert proof.counterexample is not None
    file = tmp_path / "flight.json"
    write_certificate(proof, network.read_bytes(), file)
    table = json.loads(file.read_text())
    table["flight"][1][1] += off
    content = json.dumps(table).encode()
    if is_accepted:
        assert verdict(content, network.read_bytes()) < -1.0
        return
    from rans_proof.balls import Refused

    with pytest.raises(Refused, match="another one in period 0"):
        verdict(content, network.read_bytes())


def test_the_checker_agrees_about_rectifiers(tmp_path: Path) -> None:
    """Rectifiers below a last layer of tanh, whose commands push a craft at the limit of its speed."""
    hidden, last = layers([4, 8, 2], 5, scale=0.05)
    both = [Layer(hidden.weight, hidden.bias, "relu"), last]
    network = written(both, tmp_path / "net.onnx")
    proof = prove(problem_of(HOLDING), read_network(network))
    assert proof.is_whole
    write_certificate(proof, network.read_bytes(), tmp_path / "ball.json")
    found = verdict((tmp_path / "ball.json").read_bytes(), network.read_bytes())
    # They bound the way between control instants each in its own way.
    assert found == pytest.approx(proof.margins.min(), rel=0.01)


def test_turns_of_many_periods_do_not_widen_balls(tmp_path: Path) -> None:
    """A turn by 0.8 rad multiplies radii by up to 1.4, which are rounding alone; 200 turns make 1e29 of it."""
    from rans_proof.check import Loop
    from rans_proof.check_problem import problem_table

    network = written([Layer(np.zeros((1, 2)), np.zeros(1), "tanh")], tmp_path / "net.onnx")
    text = """
name = "an oscillator"
period = 0.8
steps = 200
commands = 1
derivative = ["x1 + 0 * u0", "-x0"]
start = {lower = [0.9, 0.0], upper = [1.0, 0.0]}
keep.within = {lower = [-1.1, -1.1], upper = [1.1, 1.1]}
"""
    margin = Loop(problem_table(text), network.read_bytes()).margin([(0.9, 1.0), (0.0, 0.0)])
    # Over a period a chord is 8 % of the circle's radius away from it.
    assert 0.0 < margin < 0.1


def test_states_that_follow_from_exact_ones_need_no_shorter_steps() -> None:
    """A box that a step does not leave is guessed once more for each state of a chain that begins at rest."""
    from flint import arb, arb_mat, ctx
    from rans_proof.balls import column
    from rans_proof.check_motion import Plant

    ctx.prec = 80
    rates = ["x1", "x2", "x3", "x4", "u0"]
    pieces = Plant(rates, 1, 0.1).move(
        arb_mat(5, 1), arb_mat(5, 1), arb_mat(1, 5), column([arb(1)]), [arb(0)]
    )
    assert len(pieces) == 1
    (_, end, _) = pieces[0]
    # x_k is t^(5 - k) / (5 - k)!
    expected = [1e-5 / 120, 1e-4 / 24, 1e-3 / 6, 1e-2 / 2, 0.1]
    np.testing.assert_allclose([float(x.mid()) for x in end[0].entries()], expected, rtol=1e-9)
