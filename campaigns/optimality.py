"""How close the best on/off controls found come to what no on/off controller can beat.

Run ``python -m campaigns.optimality --starts 128 --quantity time`` for a table: per start the certified
bound, the best control found, both replayed and exact, and what it took. A process takes 0.4 GB, a start
2 s of processor time, after 5 s of compiling; ``--quantity fuel --horizon 20`` up to a minute a start. With
``--spacecraft free-flyer``, after ``pip install ./examples/plugins/space_certificates``, the bound is that of
`rans_space_certificates.reach`, some seconds a start, and the search takes one to three times ``--seconds``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from campaigns.command import ended
from rans.errors import ConfigError
from rans.model.fields import map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.optimal.certificate.certificate import (
    Certificate,
    bounder,
    certified_least_fuel,
    certified_least_time,
)
from rans.optimal.certificate.goal_set import GoalSet
from rans.optimal.certificate.hull import settling_set
from rans.optimal.certificate.problem import Problem, SearchEffort
from rans.processes import Workers, nothing
from rans.scenario import EVALUATION_SEED, Scenario, scenarios
from rans.tasks import GoToPose
from rans.terminal import Terminal
from validation.study.checks import Check, Curve, Study

Quantity = Literal["fuel", "time", "settling"]
"""Impulse to be at rest in the goal set at a time; the first time there; or that of being within the
tolerances at a speed that allows to stay, before which nobody settles."""
_HEADINGS = "start    dual   lower   upper    gap   nodes  seconds"


@dataclass(frozen=True)
class Optimality:
    """Certified least fuel, time or settling time of every on/off controller, against what was found."""

    quantity: Quantity = "fuel"
    """What to minimise."""
    spacecraft: str = "floating-platform"
    """Name of a spacecraft that comes with RANS, or your own TOML file."""
    starts: int = 8
    """Of the evaluation of go-to-pose."""
    horizon: float = 10.0
    """Time of arrival for fuel, longest time tried for the others, s."""
    seconds: float = 20.0
    """Processor time for every level of fuel, or number of control periods, that is neither excluded nor
    reached."""
    workers: int | None = None
    """Processes; by default one per processor."""
    output: Path | None = None
    """JSON file to write, with the bound and the best found of every start."""

    def run(self) -> Study:
        """Print a line per start as it is done, and return the checks."""
        craft = load_spacecraft(self.spacecraft)
        if self.starts < 1:
            raise ConfigError(f"starts must be >= 1, got {self.starts}.")
        batch = scenarios(GoToPose().for_evaluation(), craft, EVALUATION_SEED, self.starts)
        answers = []
        print(f"least {self.quantity}\n{_HEADINGS}")  # noqa: T201
        for index, answer in enumerate(self._answers(craft, batch)):
            answers.append(answer)
            print(_line(index, answer), flush=True)  # noqa: T201
        study = report(self.quantity, self.horizon, answers, craft.dimension)
        if self.output:
            settings = {
                "spacecraft": self.spacecraft,
                "horizon": self.horizon,
                "seconds": self.seconds,
            }
            replace(study, settings=settings | study.settings).write(self.output)
        return study

    def _answers(self, craft: Spacecraft, batch: Scenario) -> Iterator[Certificate]:
        period = Timing().control_period
        common = (craft, period, self.quantity, max(1, round(self.horizon / period)), self.seconds)
        jobs = [
            (*common, map_leaves(lambda x, k=k: float(x[k]), batch)) for k in range(self.starts)
        ]
        yield from Workers(nothing, (), self.workers, "certified starts").ordered(
            _certificate, jobs
        )


def _certificate(_: None, *job: Any) -> Certificate:
    return certificate(*job)


def certificate(
    craft: Spacecraft,
    period: float,
    quantity: Quantity,
    steps: int,
    seconds: float,
    scenario: Scenario,
) -> Certificate:
    """One start's answer; see `rans.optimal.certificate.certificate`."""
    effort = SearchEffort(seconds)
    goals = GoalSet()
    wanted = {"position", "attitude", "velocity", "spin"}
    if quantity == "settling":
        goals = settling_set(craft, goals.position, goals.heading, period)
        wanted -= {"spin"}  # of its bound the proof is for the plane, whose search always has it
    problem = Problem(scenario.start, scenario.goal, goals, wanted)
    solve = certified_least_fuel if quantity == "fuel" else certified_least_time
    return solve(bounder(craft, period), problem, steps, effort)


def report(
    quantity: Quantity, horizon: float, answers: list[Certificate], dimension: int = 2
) -> Study:
    """Mean gap and share of starts not proven optimal, against what the project promises.

    A gap is a start's own, (best found - bound) / bound, and their mean is not the gap of the means: starts
    with a small bound count as much as others.
    """
    gaps = np.array([answer.gap for answer in answers])
    open_share = float(np.mean(gaps > 1e-9))
    target = 0.02 if quantity != "fuel" else 0.04 if horizon <= 10.0 else 0.1
    if dimension == 3:
        target = 0.3 if quantity == "fuel" else 0.15
    mean = Check(
        f"least {quantity}: mean gap",
        float(gaps.mean()),
        target,
        "-",
        "Promised, of every start's own gap: of time, of fuel for 10 s, for 20 s, in space of time "
        "and of fuel; infinite where no control was found.",
    )
    proven = Check(
        f"least {quantity}: not proven optimal",
        open_share,
        0.5,
        "share of starts",
        "Promised in the plane; more seconds prove more.",
    )
    checks = (mean, proven) if dimension == 2 else (mean,)
    seconds = sum(answer.seconds for answer in answers)
    lower, upper = (
        float(np.mean([getattr(a, end) for a in answers])) for end in ("lower", "upper")
    )
    return Study(
        f"least {quantity} of {len(answers)} starts",
        checks,
        {
            "seconds per start": round(seconds / len(answers), 1),
            "mean certified bound": lower,
            "mean of the best found": upper,
        },
        curves=tuple(
            Curve(
                f"least {quantity} of every start",
                name,
                tuple(range(len(answers))),
                tuple(getattr(a, end) for a in answers),
            )
            for name, end in (("certified bound", "lower"), ("best found", "upper"))
        ),
    )


def _line(index: int, answer: Certificate) -> str:
    return (
        f"{index:5d} {answer.dual:7.3f} {answer.lower:7.3f} {answer.upper:7.3f} "
        f"{100 * answer.gap:5.1f}% {answer.nodes:7d} {answer.seconds:8.1f}"
    )


def main() -> int:
    """Print the checks; 1 if one failed."""
    import tyro

    study = tyro.cli(Optimality).run()
    Terminal().table(study.table())
    return 0 if study.passed else 1


if __name__ == "__main__":
    raise SystemExit(ended("optimality", main))
