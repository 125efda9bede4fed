"""The check of certificates in ball arithmetic, which planted errors must not pass."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from rans_proof.certificate import write_certificate
from rans_proof.network import Layer, read_network
from rans_proof.problem import problem_of
from rans_proof.prove import prove

from rans.cli import main
from tests.support.small_networks import damping, written

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


def test_a_state_that_never_changes_needs_no_margin_at_the_end(tmp_path, monkeypatch):
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
    layers = read_network(network)
    content = network.read_bytes()
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
def certificate(tmp_path_factory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("proof")
    network = written(damping(4, (2, 3), 3), folder / "net.onnx")
    (folder / "docking.toml").write_text(DOCKING)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rans_proof.command._CELLS", 2)  # 16 cells are checked in a second
        assert main(f"prove {network} --problem {folder}/docking.toml".split()) == 0
    return network, folder / "docking.certificate.json"


def verdict(certificate: bytes, network: bytes) -> float:
    pytest.importorskip("flint")
    from rans_proof.check import check

    return check(certificate, network)


def test_the_checker_agrees(certificate):
    network, file = certificate
    table = json.loads(file.read_bytes())
    found = verdict(file.read_bytes(), network.read_bytes())
    # Both bound the same flights; polygons of 64 and of 48 sides differ by 0.1 % of a speed of 0.4 m/s.
    assert found == pytest.approx(min(table["margins"]), abs=1e-3)
    # The least is that of all cells, whichever comes last.
    table |= {name: table[name][1:] + table[name][:1] for name in ("cells", "margins")}
    assert verdict(json.dumps(table).encode(), network.read_bytes()) == found


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
def test_a_certificate_of_another_problem_is_refused(old, new, name, certificate, tmp_path, capsys):
    pytest.importorskip("flint")
    network, file = certificate
    problem = tmp_path / "other.toml"
    assert old in DOCKING
    problem.write_text(DOCKING.replace(old, new))
    line = f"prove {network} --check {file} --problem {problem}"
    assert main(line.split()) == bool(name)
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


def test_a_flight_that_refutes_is_flown_again(certificate, tmp_path, capsys):
    """A limit that the fastest starts break at once; what is refused instead is in soundness.py."""
    pytest.importorskip("flint")
    network = certificate[0]
    problem = tmp_path / "false.toml"
    file = tmp_path / "flight.json"
    problem.write_text(DOCKING.replace("base = 0.2", "base = -0.1"))
    assert main(f"prove {network} --problem {problem} --output {file}".split()) == 1
    assert capsys.readouterr().out.startswith("False: ")
    table = json.loads(file.read_text())
    start = np.array(table["flight"][0])
    broken = np.linalg.norm(start[2:]) - (-0.1 + 0.002 * np.linalg.norm(start[:2]))
    assert -verdict(file.read_bytes(), network.read_bytes()) >= broken - 1e-9 > -1e-9
    assert main(f"prove {network} --check {file}".split()) == 0
    assert "breaks the property" in capsys.readouterr().out


@pytest.mark.parametrize(("off", "is_accepted"), [(0.0, True), (2e-4, True), (2e-2, False)])
def test_a_flight_that_refutes_may_differ_by_rounding(off, is_accepted, tmp_path):
    """u = tanh(((10^4 + x) - (10^4 - x)) / 2) in single precision, whose numbers near 10^4 are 0.001 apart.

    Rounding changes u by up to 0.0005 and the velocity after 0.5 s by 0.00025, which is more than the 1e-6 that a
    flight in double precision may be off.
    """
    sums = Layer(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.full(2, 1e4), "relu")
    network = written(
        [sums, Layer(np.array([[0.5, -0.5]]), np.zeros(1), "tanh")], tmp_path / "net.onnx"
    )
    lower = "lower = [-1.0, -0.2]\nupper"
    upper = "upper = [1.0, 0.2]"
    fast = SETTLING.replace(lower, "lower = [1.0, 0.2]\nupper").replace(upper, "upper = [1.1, 0.3]")
    assert fast.count("0.2]") == 1
    proof = prove(problem_of(fast), read_network(network))
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


def test_turns_of_many_periods_do_not_widen_balls(tmp_path):
    """A turn by 0.8 rad multiplies radii by up to 1.4, which are rounding alone; 140 turns make 1e20 of it."""
    from rans_proof.check import Loop
    from rans_proof.check_problem import problem_table

    network = written([Layer(np.zeros((1, 2)), np.zeros(1), "tanh")], tmp_path / "net.onnx")
    text = """
name = "an oscillator"
period = 0.8
steps = 140
commands = 1
derivative = ["x1 + 0 * u0", "-x0"]
start = {lower = [0.9, 0.0], upper = [1.0, 0.0]}
keep.within = {lower = [-1.1, -1.1], upper = [1.1, 1.1]}
"""
    margin = Loop(problem_table(text), network.read_bytes()).margin([(0.9, 1.0), (0.0, 0.0)])
    # Over a period a chord is 8 % of the circle's radius away from it.
    assert 0.0 < margin < 0.1


@pytest.mark.parametrize("hole", ["1 / x0", "x0 / x0", "exp(1 / x0)"])
def test_the_check_of_a_formula_with_a_hole_ends(hole, tmp_path, monkeypatch):
    """Within 100 Taylor steps and 5 for each period, after which no half of the cell is tried."""
    from rans_proof import check, check_motion
    from rans_proof.balls import Refused

    monkeypatch.setattr(check, "_EFFORT", (100, 5))
    tried = []
    step = check_motion.Plant._step
    monkeypatch.setattr(check_motion.Plant, "_step", lambda *given: tried.append(0) or step(*given))
    network = written(damping(2, (1,), 3), tmp_path / "net.onnx").read_bytes()
    text = SETTLING.replace('"x1"', f'"{hole}"')
    table = {"format": 1, "network": hashlib.sha256(network).hexdigest(), "problem": text}
    table |= {"cells": [[[-1.0, -0.2], [1.0, 0.2]]], "margins": [1.0]}
    with pytest.raises(Refused, match="more steps than are tried"):
        check.check(json.dumps(table).encode(), network)
    assert len(tried) <= 100 + 5 * 40


def test_a_set_holds_a_motion_that_its_series_does_not_end():
    """x' = x^2 from 0.5 is 1 / (2 - t): after 0.5 s the series is 1.3e-8 off, and its rests add up to 1.6e-8."""
    from flint import arb, arb_mat, ctx
    from rans_proof.balls import absolute_row_sums, column
    from rans_proof.check_motion import Plant

    ctx.prec = 80
    start = column([arb("0.5")])
    pieces = Plant(["x0 * x0 + 0 * u0"], 1, 0.5).move(
        start, arb_mat(1, 1), arb_mat(1, 1), column([arb(0)]), [arb(0)]
    )
    _, (centre, spread), _ = pieces[-1]
    off = abs(float(centre[0, 0].mid()) - 2.0 / 3.0)
    assert 1e-9 < off < float(absolute_row_sums(spread)[0])


@pytest.mark.parametrize(("upper", "is_proved"), [(1.5, False), (2.5, True)])
def test_an_end_is_asked_of_the_last_instant_alone(upper, is_proved, tmp_path):
    """From 0 at 0.9 to 1 m/s it is within 1.5 m after the first of two seconds, and beyond after both."""
    from rans_proof.check import Loop
    from rans_proof.check_problem import problem_table

    network = written([Layer(np.zeros((1, 2)), np.zeros(1), "tanh")], tmp_path / "net.onnx")
    text = f"""
name = "a mass that coasts"
period = 1.0
steps = 2
commands = 1
derivative = ["x1 + 0 * u0", "0"]
start = {{lower = [0.0, 0.9], upper = [0.1, 1.0]}}
end = {{lower = [0.4, 0.8], upper = [{upper}, 1.1]}}
"""
    loop = Loop(problem_table(text), network.read_bytes())
    assert (loop.margin([(0.0, 0.1), (0.9, 1.0)]) > 0.0) == is_proved


def test_states_that_follow_from_exact_ones_need_no_shorter_steps():
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


def test_agents_and_other_files_are_refused_by_what_can_be_proved(refused):
    for typed in ("flight.csv", "track-velocity-2d --problem docking.toml"):
        assert "the file of a network that ends in .onnx" in refused(f"prove {typed}")
