"""Solvers that several threads share: the statistics that one reads are of its own solution."""

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
from rans_optimal.solver import solution_of

from tests.support.sources import sources

OPTIONS = {
    "error_on_fail": False,
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.max_iter": 30,
    "ipopt.sb": "yes",
}


def test_threads_read_the_statistics_of_their_own_solutions():
    """x of at least p and at most 1 is there for p = 0, and not for p = 2."""
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    solver = ca.nlpsol("x", "ipopt", {"x": x, "p": p, "f": x**2, "g": x - p}, OPTIONS)

    def successes(p):
        answers = (solution_of(solver, p=p, lbx=-1.0, ubx=1.0, lbg=0.0) for _ in range(50))
        return {statistics["success"] for _, statistics in answers}

    with ThreadPoolExecutor(2) as pool:
        assert [*pool.map(successes, [0.0, 2.0])] == [{True}, {False}]


def test_nobody_reads_statistics_past_the_lock():
    reading = {name for name, file in sources() if ".stats()" in file.read_text("utf-8")}
    assert reading == {solution_of.__module__}
