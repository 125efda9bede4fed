"""A harness of sound and tight bounds, for the prover's and the checker's sets of states.

Each part computes random cases densely by formulas of its own, and asserts that no sample is outside of a bound and
that the bound is not much wider than the samples: an unsound bound fails, and so does a useless one. `Checker` and
`Prover` say both programs' bounds in numbers.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
import pytest
from rans_proof.network import Layer

from tests.support.graphs import SHIFT, WEIGHT, graph, step
from tests.support.small_networks import layers as random_layers

CHECKER = (
    "rans_proof.balls",
    "rans_proof.claims",
    "rans_proof.network_reader",
    "rans_proof.check_motion",
    "rans_proof.check_property",
    "rans_proof.check_problem",
    "rans_proof.check",
)
"""Modules of the checker, each after those that it imports."""
PROVER = (
    "rans_proof.relaxation",
    "rans_proof.formula",
    "rans_proof.problem",
    "rans_proof.flights",
    "rans_proof.plants",
    "rans_proof.motion",
    "rans_proof.prove",
)
"""Modules of the prover, in such an order, too."""

BENDS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "tanh": np.tanh,
    "sigmoid": lambda z: 1.0 / (1.0 + np.exp(-z)),
    "relu": lambda z: z * (z > 0.0),
    "": lambda z: z,
}


class Set(NamedTuple):
    """States centre + generators s with |s| <= 1."""

    centre: np.ndarray
    """(n,)."""
    generators: np.ndarray
    """(n, k)."""

    @classmethod
    def between(cls, low: np.ndarray, high: np.ndarray) -> Set:
        """A box."""
        return cls(0.5 * (low + high), np.diag(0.5 * (high - low)))

    def corners(self, extra: int, random: np.random.Generator) -> np.ndarray:
        """(N, n) states at corners, all of them if there are few, and random ones."""
        count = self.generators.shape[1]
        signs = np.array(list(itertools.product((-1.0, 1.0), repeat=count)))
        if len(signs) > 256:
            signs = random.choice((-1.0, 1.0), (256, count))
        signs = np.concatenate((signs, random.uniform(-1.0, 1.0, (extra, count))))
        return self.centre + signs @ self.generators.T

    def highest(self, directions: np.ndarray) -> np.ndarray:
        """(d,) largest values of linear functions (d, n)."""
        return directions @ self.centre + np.abs(directions @ self.generators).sum(axis=1)


class Piece(NamedTuple):
    """Set at the begin and end of a part of a motion, and how far it is off the straight line."""

    begin: Set
    end: Set
    sag: np.ndarray


class Checker:
    """Bounds of the checker in ball arithmetic."""

    def __init__(self, modules: Mapping[str, ModuleType]) -> None:
        import flint

        flint.ctx.prec = 80
        self.balls: Any = modules["rans_proof.balls"]
        self.check: Any = modules["rans_proof.check"]
        self.motion: Any = modules["rans_proof.check_motion"]
        self.problem: Any = modules["rans_proof.check_problem"]
        self.refusals = (self.balls.Refused,)
        self._arb = flint.arb

    def _column(self, values: np.ndarray) -> Any:
        return self.balls.matrix(np.asarray(values, dtype=float).reshape(-1, 1))

    def _set(self, states: Set) -> Any:
        return self._column(states.centre), self.balls.matrix(states.generators)

    @staticmethod
    def _array(table: Any) -> np.ndarray:
        return np.array([[float(x.mid()) for x in row] for row in table.tolist()])

    def _numbers(self, values: Any) -> np.ndarray:
        return np.array([float(x.upper()) for x in values])

    def _layers(self, network: Sequence[Layer]) -> Any:
        return [
            (self.balls.matrix(weight), self._column(bias), activation.capitalize())
            for weight, bias, activation, _ in network
        ]

    def enclosure(self, network: Sequence[Layer], states: Set) -> tuple[np.ndarray, ...]:
        """Gain, offset and error."""
        gain, offset, error = self.balls.network_enclosure(
            self._layers(network), *self._set(states)
        )
        return self._array(gain), self._array(offset)[:, 0], self._numbers(error)

    def move(
        self, problem: str, states: Set, gain: np.ndarray, offset: np.ndarray, error: np.ndarray
    ) -> list[Piece]:
        """Pieces of a control period."""
        table = self.problem.problem_table(problem)
        motion = self.motion.Plant(table["derivative"], table["commands"], table["period"]).move
        # Generators that are a box at the end are radii of the centre's balls.
        centre, spread = self._set(states)
        count = len(states.centre)
        box = states.generators[:, count:]
        if box.any():
            balls = [self._arb(c, r) for c, r in zip(states.centre, np.diag(box), strict=True)]
            centre = self.balls.column(balls)
            spread = self.balls.matrix(states.generators[:, :count])
        pieces = motion(
            *(centre, spread),
            self.balls.matrix(gain),
            self._column(offset),
            [self._arb(float(x)) for x in error],
        )

        def numbers(ends: Any) -> Set:
            radii = np.diag([float(x.rad()) for x in ends[0].entries()])
            return Set(
                self._array(ends[0])[:, 0], np.concatenate((self._array(ends[1]), radii), axis=1)
            )

        return [
            Piece(numbers(begin), numbers(end), self._numbers(sag)) for begin, end, sag in pieces
        ]

    def bent(
        self, text: str, centre: np.ndarray, radius: np.ndarray, signs: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Bounds (N,) of a formula at the states centre + signs * radius."""
        import flint

        flint.ctx.cap = 1
        series = flint.arb_series
        variables = [
            self.motion.Sloped(series([c]), series([self._arb(c, r)]), {k: series([1])})
            for k, (c, r) in enumerate(zip(centre.tolist(), radius.tolist(), strict=True))
        ]
        value = self.motion.formula(text, ["x0", "x1"])(variables)
        sums = [
            value.at[0]
            + sum((p[0] * self._arb(row[k]) for k, p in value.slopes.items()), self._arb(0))
            for row in (signs * radius).tolist()
        ]
        over = float(value.over[0].lower()), float(value.over[0].upper())
        low, high = (
            np.array([float(getattr(x, end)()) for x in sums]) for end in ("lower", "upper")
        )
        return np.maximum(low, over[0]), np.minimum(high, over[1])

    def is_bounded(self, text: str, state: np.ndarray, step: float) -> bool:
        """Whether a box is known that the motion of a step from a state does not leave."""
        table = self.problem.problem_table(text)
        plant = self.motion.Plant(table["derivative"], table["commands"], table["period"])
        return plant.during([self._arb(x) for x in state], self._arb(step)) is not None

    def reduced(self, states: Set) -> Set:
        """A set of fewer generators."""
        centre, spread = self.motion.reduced(*self._set(states))
        return Set(self._array(centre)[:, 0], self._array(spread))

    def wrong_axes(self) -> Any:
        """Context in which parts along the axes of a reduction are a tenth too small."""
        right = np.linalg.inv
        return mock.patch.object(np.linalg, "inv", lambda axes: 0.9 * right(axes))

    def margin(self, problem: str, piece: Piece) -> float:
        """Margin of a piece."""
        keep = self.problem.problem_table(problem)["keep"]
        sag = [self._arb(float(x)) for x in piece.sag]
        keep = self.check.Property(keep, len(sag))
        return float(keep.margin(self._set(piece.begin), self._set(piece.end), sag))

    def flight(
        self,
        problem: str,
        network: Sequence[Layer],
        low: np.ndarray,
        high: np.ndarray,
        depth: int = 0,
    ) -> float:
        """Margin of all flights from a cell."""
        table = self.problem.problem_table(problem)
        self.check.layers_of = lambda *_: self._layers(network)
        cell = list(zip(low.tolist(), high.tolist(), strict=True))
        return self.check.Loop(table, b"").margin(cell, depth)


class Prover:
    """Bounds of the prover in double precision."""

    def __init__(self, modules: Mapping[str, ModuleType]) -> None:
        import torch

        self.torch = torch
        self.relaxation: Any = modules["rans_proof.relaxation"]
        self.problem: Any = modules["rans_proof.problem"]
        self.proof: Any = modules["rans_proof.prove"]
        self.plants: Any = modules["rans_proof.plants"]
        self.motion: Any = modules["rans_proof.motion"]
        self.formula: Any = modules["rans_proof.formula"]
        self.refusals: tuple[type[Exception], ...] = ()

    def _tensor(self, array: Any) -> Any:
        return self.torch.tensor(np.asarray(array, dtype=float))[None]

    def _set(self, states: Set) -> Any:
        """Its last generators are the box, where they are one."""
        count = len(states.centre)
        rest, last = np.split(states.generators, [-count], axis=1)
        box = np.abs(np.diag(last))
        if not np.array_equal(np.abs(last), np.diag(box)):
            rest, box = states.generators, np.zeros(count)
        return self.relaxation.Zonotope(*map(self._tensor, (states.centre, rest, box)))

    @staticmethod
    def _numbers(zonotope: Any) -> Set:
        centre, generators, box = (x[0].numpy() for x in zonotope)
        return Set(centre, np.concatenate((generators, np.diag(box)), axis=1))

    def _loop(self, problem: str, network: Sequence[Layer]) -> Any:
        return self.proof.ClosedLoop(
            self.problem.problem_of(problem), network, self.torch.device("cpu")
        )

    def enclosure(self, network: Sequence[Layer], states: Set) -> tuple[np.ndarray, ...]:
        """Gain, offset and error."""
        tensors = [
            Layer(self.torch.tensor(w), self.torch.tensor(b), kind) for w, b, kind, _ in network
        ]
        return tuple(x[0].numpy() for x in self.relaxation.enclose(tensors, self._set(states)))

    def move(
        self, problem: str, states: Set, gain: np.ndarray, offset: np.ndarray, error: np.ndarray
    ) -> list[Piece]:
        """Pieces of a control period."""
        network = [Layer(gain, offset, "")]
        planes = self.relaxation.Planes(*map(self._tensor, (gain, offset, error)))
        pieces = self._loop(problem, network)._plant.move(self._set(states), planes)
        return [
            Piece(self._numbers(piece.begin), self._numbers(piece.end), piece.sag[0].numpy())
            for piece in pieces
        ]

    def bent(
        self, text: str, centre: np.ndarray, radius: np.ndarray, signs: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Bounds (N,) of a formula at the states centre + signs * radius."""
        tape = self.motion.Tape(2)
        value = tape.node(
            self.formula.formula_value(text, dict(zip(("x0", "x1"), tape.variables, strict=True)))
        )
        rows = np.diag(radius)
        forms = [
            self.motion.Form(self._tensor(c), self._tensor(row), self._tensor(0.0))
            for c, row in zip(centre, rows, strict=True)
        ]
        series = self.motion.Series(tape, [value, value], forms)
        series.extend()
        c, g, e = (x[0].numpy() for x in series.states[0][1])
        return c + signs @ g - e, c + signs @ g + e

    def is_bounded(self, text: str, state: np.ndarray, step: float) -> bool:
        """Whether a box is known that the motion of a step from a state does not leave."""
        plant = self.motion.TaylorPlant(self.problem.problem_of(text), self.torch.device("cpu"))
        none = self.torch.zeros((1, 0), dtype=self.torch.float64)
        boxes = [self.motion.Form(self._tensor(x), none, self._tensor(0.0)) for x in state]
        return bool(self.torch.isfinite(plant._during(boxes, step)[0].centre).all())

    def reduced(self, states: Set) -> Set:
        """A set of fewer generators."""
        parts = *states, np.zeros(len(states.centre))
        sets = self.relaxation.Zonotope(*map(self._tensor, parts))
        return self._numbers(self.proof.reduced(sets))

    def wrong_axes(self) -> Any:
        """Context in which axes of a reduction are half as long as they should be."""
        right = self.torch.linalg.eigh

        def short(matrix: Any) -> tuple[Any, Any]:
            values, axes = right(matrix)
            return values, 0.5 * axes

        return mock.patch.object(self.torch.linalg, "eigh", short)

    def margin(self, problem: str, piece: Piece) -> float:
        """Margin of a piece."""
        problem_ = self.problem.problem_of(problem)
        network = [
            Layer(np.zeros((problem_.commands, problem_.states)), np.zeros(problem_.commands), "")
        ]
        ends = map(self._set, (piece.begin, piece.end))
        sets = self.plants.Piece(*ends, self._tensor(piece.sag))
        return float(self._loop(problem, network)._margin(sets).nan_to_num(-np.inf))

    def flight(
        self, problem: str, network: Sequence[Layer], low: np.ndarray, high: np.ndarray
    ) -> float:
        """Margin of all flights from a cell."""
        return float(self._loop(problem, network).margins(low[None], high[None])[0][0])


Bounds = Checker | Prover


def answers(network: Sequence[Layer], states: np.ndarray) -> np.ndarray:
    """Answers (N, outputs) to states (N, inputs)."""
    for weight, bias, activation, _ in network:
        states = BENDS[activation](np.einsum("oi,ni->no", weight, states) + bias)
    return states


def enclosures(bounds: Bounds) -> None:
    """Networks lie between their planes, which no one layer's error makes much wider than the network bends."""
    random = np.random.default_rng(2)
    for kind, sizes in itertools.product(
        ("tanh", "sigmoid", "relu"), ((2, 3), (2, 4, 2), (2, 3, 4, 2), (2, 3, 3, 3, 2))
    ):
        network = [
            Layer(weight, 2.0 * bias, activation)
            for weight, bias, activation, _ in random_layers(sizes, len(sizes), kind, 1.5)
        ]
        if len(sizes) == 3:  # a last layer that does not bend
            network[-1] = network[-1]._replace(activation="")
        worst = 0.0
        for width in (0.02, 0.2):
            generators = np.concatenate(
                (width * random.normal(size=(2, 2)), width * np.diag(random.random(2))), axis=1
            )
            states = Set(random.normal(size=2), generators)
            gain, offset, error = bounds.enclosure(network, states)
            x = states.corners(1000, random)
            off = np.abs(answers(network, x) - x @ gain.T - offset)
            assert (off <= error + 1e-12).all()
            reach = np.abs(gain @ generators).sum(axis=1).max() + error.max() + 1e-9
            worst = max(worst, float((error - off.max(axis=0)).max()) / reach)
        # What an enclosure adds to the samples is a part of how far the answers reach.
        assert worst <= 0.35, worst


PLANTS = {
    "a line": ('["x1", "0.5 * u0"]', 1, 0.8),
    "a growing line": ('["0.7 * x0 + x1", "1.1 * x0 + 0.4 * x1 + u0"]', 1, 0.9),
    "a turn": (
        '["x1 + 0.3 * u1", "-1.5 * x0 + 0.2 * x1 + 0.7 * u0", "0.4 * x0 - x2 + u1"]',
        2,
        0.5,
    ),
    "a square": ('["0.6 * x0 * x0 + 0.3 * u0", "x0 * x1"]', 1, 0.6),
    "a cube": ('["x1", "0.5 * x0 * x0 * x0 - x1 + u0 * x0"]', 1, 0.5),
    "an asymmetric body": (
        '["0.8 * x1 * x2 + u0", "-1.2 * x0 * x2", "0.7 * x0 * x1 + u1"]',
        2,
        0.6,
    ),
    "a pendulum": ('["x1", "1.2 * sin(x0) + cos(x1) * u0"]', 1, 0.4),
    "quotients": ('["x1 / (2 + x0 * x0) + u0", "0.5 * exp(-x0) - x1 / (3 + x0)"]', 1, 0.4),
    "roots": ('["sqrt(4 + x0) - tan(0.4 * x1)", "u0 * sqrt(4 - x1) / (4 + x1)"]', 1, 0.4),
}
"""Rates, number of commands and period."""


def problem_text(
    plant: tuple[str, int, float], low: Any, high: Any, limits: str, steps: int = 1
) -> str:
    """Text of a problem of a plant, its starts from low to high, and the tables of what its flights keep."""
    rates, commands, period = plant
    box = f"[start]\nlower = {list(map(float, low))}\nupper = {list(map(float, high))}\n"
    head = f'name = "random"\nperiod = {period}\nsteps = {steps}\ncommands = {commands}\nderivative = {rates}\n'
    return head + box + limits


def within(count: int) -> str:
    """A box around the origin that flights stay in."""
    return keep_text("within", {"lower": [-1e6] * count, "upper": [1e6] * count})


_FUNCTIONS = {name: getattr(np, name) for name in ("sin", "cos", "tan", "exp", "sqrt")}


def motion(
    rates: str, states: np.ndarray, commands: np.ndarray, period: float, instants: int
) -> np.ndarray:
    """States (instants + 1, N, n) of plants with held commands (N, p), by Runge-Kutta steps of order 4.

    Formulas are computed by Python, which reads them by itself.
    """
    codes = [compile(text, "rates", "eval") for text in json.loads(rates)]
    names = {f"u{i}": u for i, u in enumerate(commands.T)}

    def rate(x: np.ndarray) -> np.ndarray:
        values = names | {f"x{i}": row for i, row in enumerate(x.T)}
        rates = np.empty_like(x)
        for column, code in enumerate(codes):
            rates[:, column] = eval(code, _FUNCTIONS, values)
        return rates

    x = states
    path = [x]
    h = period / instants
    for _ in range(instants):
        a = rate(x)
        b = rate(x + 0.5 * h * a)
        c = rate(x + 0.5 * h * b)
        d = rate(x + h * c)
        x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        path.append(x)
    return np.stack(path)


_LINEAR = ("a line", "a growing line", "a turn")


def linear_motions(bounds: Bounds) -> None:
    """As `motions`, of linear plants."""
    motions(bounds, _LINEAR)


def motions(
    bounds: Bounds, names: Sequence[str] = tuple(name for name in PLANTS if name not in _LINEAR)
) -> None:
    """Flights of a period are in their sets, off chords by at most the sag; and both nearly reach their bounds."""
    random = np.random.default_rng(4)
    for name in names:
        rates, commands, period = PLANTS[name]
        count = rates.count('"') // 2
        is_linear = name in _LINEAR
        # Points, whose sets have the width of a Taylor step's rest alone; states that differ; wrong commands; and
        # states below zero in a box.
        sets = [(0.0, 0.0, 1.0), (0.05, 0.0, 1.0), (0.02, 0.1, 1.0), (0.0, 0.0, -1.0)]
        sets = sets if is_linear else sets[2:]
        for width, error, sign in sets:
            centre = sign * (0.6 + 0.6 * random.random(count))
            box = np.diag(0.05 * random.random(count)) * (sign < 0.0)
            generators = np.concatenate((width * random.normal(size=(count, count)), box), axis=1)
            states = Set(centre, generators)
            gain = 0.4 * random.random((commands, count))
            offset = sign * (0.3 + random.random(commands))
            wrong = error * (1.0 + random.random(commands))
            text = problem_text(PLANTS[name], centre, centre, within(count))
            pieces = bounds.move(text, states, gain, offset, wrong)
            # Flights from all corners, with all errors; 240 steps of a period err by 1e-10.
            dense = 240 // len(pieces)
            x = states.corners(20, random)
            ends = np.array(list(itertools.product((-1.0, 1.0), repeat=commands))) * wrong
            u = (x @ gain.T + offset)[:, None] + ends[None]
            path = motion(
                rates,
                np.repeat(x, len(ends), axis=0),
                u.reshape(-1, commands),
                period,
                len(pieces) * dense,
            )
            directions = np.concatenate(
                (np.eye(count), -np.eye(count), random.normal(size=(8, count)))
            )
            first = path[0]
            assert (
                np.max(first @ directions.T, axis=0) <= pieces[0].begin.highest(directions) + 1e-9
            ).all()
            excess = sag = np.zeros(count)
            for number, piece in enumerate(pieces):
                part = path[dense * number : dense * (number + 1) + 1]
                excess = piece.end.highest(directions) - np.max(part[-1] @ directions.T, axis=0)
                assert (excess >= -1e-9).all(), (name, width, error)
                fraction = np.linspace(0.0, 1.0, dense + 1)[:, None, None]
                sag = np.abs(part - part[0] - fraction * (part[-1] - part[0])).max(axis=(0, 1))
                assert (sag <= piece.sag + 1e-9).all(), (name, width, error)
            # A sag's bound adds absolute values: it is near where all terms have one sign, unlike in turns.
            span = np.max(path[-1] @ directions.T, axis=0) + np.max(
                path[-1] @ -directions.T, axis=0
            )
            travel = np.abs(path[-1] - path[0]).max()
            assert excess.max() <= (
                # A step's rest may be a millionth of the state, and a part of a set's width.
                1e-6 + 0.001 * width
                if is_linear and not box.any()
                else 0.1 * travel + 0.35 * span.max()
            ), (
                name,
                width,
                error,
                excess,
            )
            near = {"a line": 2.5, "a growing line": 2.5, "a square": 5.0, "a cube": 10.0}
            largest = near.get(name, 40.0) if sign > 0.0 else 40.0
            assert (pieces[-1].sag <= largest * np.maximum(sag, 0.1 * sag.max())).all(), name


def explosions(bounds: Bounds) -> None:
    """A motion that leaves every box has no bound from then on, and none is said."""
    # x = 30 / (1 - 30 t) is infinite after 0.033 s, in the first Taylor step of both programs.
    text = problem_text(('["x0 * x0", "u0"]', 1, 1.0), [30.0, 0.0], [30.0, 0.0], within(2))
    states = Set(np.array([30.0, 0.0]), np.zeros((2, 4)))
    assert not bounds.is_bounded(text, np.array([30.0, 0.0, 0.0]), 0.04)
    assert bounds.is_bounded(text, np.array([30.0, 0.0, 0.0]), 0.002)
    try:
        pieces = bounds.move(text, states, np.zeros((1, 2)), np.zeros(1), np.zeros(1))
    except bounds.refusals:
        return
    assert not np.isfinite(pieces[0].end.generators).all()


def true_margins(keep: str, limit: Mapping[str, Any], x: np.ndarray) -> np.ndarray:
    """Margins (N,) of states (N, n)."""
    if keep in ("avoid", "within", "end"):
        inside = np.minimum(x - limit["lower"], np.array(limit["upper"]) - x)
        return -inside.min(axis=1) if keep == "avoid" else inside.min(axis=1)
    if keep in ("every", "some"):
        values = x @ np.array(limit["rows"]).T + np.array(limit["offsets"])
        return values.min(axis=1) if keep == "every" else values.max(axis=1)
    distance = np.sqrt((x[:, limit["position"]] ** 2).sum(axis=1))
    if keep in ("keep_out", "stay_in"):
        return (distance - limit["radius"]) * (1.0 if keep == "keep_out" else -1.0)
    speed = np.sqrt((x[:, limit["velocity"]] ** 2).sum(axis=1))
    return limit["base"] + limit["slope"] * distance - speed


def keep_text(keep: str, limit: Mapping[str, Any]) -> str:
    """Table of a property, or of the end."""
    if keep in ("every", "some"):
        formulas = [
            " + ".join([*(f"{f} * x{i}" for i, f in enumerate(row)), str(offset)])
            for row, offset in zip(limit["rows"], limit["offsets"], strict=True)
        ]
        return f"[keep]\n{keep} = {json.dumps(formulas)}\n"
    head = "[end]\n" if keep == "end" else f"[keep.{keep}]\n"
    return head + "".join(f"{key} = {value}\n" for key, value in limit.items())


LIMITS: dict[str, dict[str, Any]] = {
    "within": {"lower": [-9.0, -8.0, -2.0, -3.0], "upper": [7.0, 9.0, 4.0, 2.5]},
    "avoid": {"lower": [-1.0, -1.5, -2.0, -3.0], "upper": [1.0, 0.5, 4.0, 2.5]},
    "every": {"rows": [[1.0, 0.5, 0.0, -0.2], [0.0, -0.3, 1.0, 1.0]], "offsets": [5.0, 4.0]},
    "some": {"rows": [[1.0, 0.0, 0.3, 0.0], [-1.0, 0.2, 0.0, 0.0]], "offsets": [-1.0, -1.5]},
    "stay_in": {"position": [1, 3], "radius": 4.0},
    "keep_out": {"position": [1, 3], "radius": 0.7},
    "speed_limit": {"position": [0, 3], "velocity": [2, 1], "base": 0.4, "slope": 0.3},
}


def margins(bounds: Bounds) -> None:
    """No state of a piece has less than the piece's margin, and some have nearly it."""
    random = np.random.default_rng(6)
    chain = ('["x1", "x2", "x3", "u0"]', 1, 1.0)
    for keep, limit in LIMITS.items():
        text = problem_text(chain, [0.0] * 4, [0.0] * 4, keep_text(keep, limit))
        for number in range(36):
            # A third are points, of every direction; a third have a width; a third have a sag, too.
            width, sag = ((0.0, 0.0), (0.05, 0.0), (0.05, 0.04))[number % 3]
            angle = random.uniform(0.0, 2.0 * np.pi, 2)
            centre = np.empty(4)
            far = 3.0
            pairs = {"keep_out": ([1, 3], [0, 2]), "speed_limit": ([0, 3], [2, 1])}.get(
                keep, ([0, 1], [2, 3])
            )
            for pair, turn, size in zip(pairs, angle, (far, 2.0), strict=True):
                centre[pair] = size * np.array([np.cos(turn), np.sin(turn)])
            if width and keep in ("avoid", "some"):  # one axis parts the set from the box
                centre = np.array([0.0, 0.0, 0.0, 0.0])
                axis = number // 3 % 4 if keep == "avoid" else 0
                centre[axis] = random.choice((-1.0, 1.0)) * 6.0
            later = centre + (0.3 if width else 0.0) * random.normal(size=4)
            begin, last = (
                Set(
                    c,
                    width
                    * np.column_stack((random.normal(size=(4, 2)), np.diag(random.random(4)))),
                )
                for c in (centre, later)
            )
            # Off the chord along the worst diagonal: sizes of a sag are those of the state.
            sags = sag * (np.abs(centre) if sag else np.zeros(4))
            margin = bounds.margin(text, Piece(begin, last, sags))
            first, last = (end.corners(30, random) for end in (begin, last))
            chord = np.concatenate(
                [first + t * (last - first) for t in (0.0, 0.25, 0.5, 0.75, 1.0)]
            )
            signs = (
                np.array(list(itertools.product((-1.0, 1.0), repeat=4)))
                if sag
                else np.zeros((1, 4))
            )
            x = (chord[:, None] + signs * sags).reshape(-1, 4)
            least = float(true_margins(keep, limit, x).min())
            assert margin <= least + 1e-9, (keep, width, sag, margin - least)
            # A polygon of 48 sides is 0.2 % outside of the circle; along one direction a distance is up to its
            # width squared too short; and the largest lengths of both parts of a sag do not add up.
            speed = 3.0 if keep == "speed_limit" else 0.0
            slack = 0.0022 * speed + (0.25 * (width > 0) + 3.0 * sag if keep in BALLS else 0.0)
            assert margin >= least - slack - 1e-8, (keep, width, sag, margin - least)
    # A chord through the origin has no direction ahead.
    for keep in ("keep_out", "speed_limit"):
        text = problem_text(chain, [0.0] * 4, [0.0] * 4, keep_text(keep, LIMITS[keep]))
        point = np.array([3.0, 0.5, 0.5, 3.0])
        begin, last = (Set(sign * point, np.zeros((4, 4))) for sign in (1.0, -1.0))
        # Half way the distance is 0, and the speed too.
        assert bounds.margin(text, Piece(begin, last, np.zeros(4))) <= (
            -0.7 if keep == "keep_out" else 0.4
        )


BALLS = ("keep_out", "stay_in", "speed_limit")
FLIGHTS = {
    "within": ("a line", {"lower": [-0.5, -2.0], "upper": [1.9, 0.9]}, 6),
    "avoid": ("a line", {"lower": [1.8, -9.0], "upper": [3.0, 9.0]}, 5),
    "keep_out": ("a line", {"position": [0], "radius": 0.3}, 1),
    "speed_limit": ("a cube", {"position": [0], "velocity": [1, 0], "base": 2.0, "slope": 0.5}, 2),
}


def flown(
    name: str,
    network: Sequence[Layer],
    x: np.ndarray,
    steps: int = 1,
    taken: Callable[[np.ndarray], np.ndarray] = lambda x: x,
) -> np.ndarray:
    """States (steps, 33, N, n) of flights of a plant, whose network takes numbers of the states."""
    rates, _, period = PLANTS[name]
    paths = []
    for _ in range(steps):
        paths.append(motion(rates, x, answers(network, taken(x)), period, 32))
        x = paths[-1][-1]
    return np.stack(paths)


def around(states: np.ndarray, spare: float) -> dict[str, Any]:
    """Limits of the box around states (N, n), and a number more."""
    return {
        "lower": (states.min(axis=0) - spare).tolist(),
        "upper": (states.max(axis=0) + spare).tolist(),
    }


def flights(bounds: Bounds) -> None:
    """No flight from a cell has less than the cell's margin at any instant or its end, and some have nearly it."""
    random = np.random.default_rng(8)
    low = np.array([0.9, 0.1])
    high = np.array([1.0, 0.15])
    for (keep, (name, limit, steps)), has_end in itertools.product(FLIGHTS.items(), (False, True)):
        network = random_layers((2, 3, 1), steps, "tanh", 0.7)
        path = flown(name, network, Set.between(low, high).corners(60, random), steps)
        least = float(true_margins(keep, limit, path.reshape(-1, 2)).min())
        limits = keep_text(keep, limit)
        if has_end:  # a box that flights end in by less than they keep the property by
            limits = keep_text("end", around(path[-1, -1], 0.02)) + limits
            least = min(least, 0.02)
        margin = bounds.flight(
            problem_text(PLANTS[name], low, high, limits, steps), network, low, high
        )
        assert margin <= least + 1e-9, (keep, has_end, margin, least)
        assert margin >= least - 0.12, (keep, has_end, margin, least)


BENT = {
    **{f"{name}(x0)": 2.2 for name in ("sin", "cos", "exp")},
    "tan(x0)": 5.0,
    **{
        "sqrt(3 + x0)": 2.2,
        "1 / (3 + x0)": 2.2,
        "2 / (x0 - 4)": 2.2,
        "x0 * x0": 2.2,
        "x0 * x1": 2.2,
    },
    **{"x1 / (3 + x0) - x0 * x1": 5.0, "sin(x0 * x1) * cos(x1)": 8.0, "-x0 / 3 - (1 - x1)": 2.2},
}
"""Formulas, and how many times as wide as the function's bend its bounds may be: those of a parabola, which is on
one side of its tangent, may be two times as wide."""


def bends(bounds: Bounds) -> None:
    """Formulas over a box of states are within linear bounds, which are about as wide apart as they bend."""
    random = np.random.default_rng(3)
    signs = np.array(list(itertools.product(np.linspace(-1.0, 1.0, 9), repeat=2)))
    for text, times in BENT.items():
        for width in (0.001, 0.1, 0.3):
            centre = random.uniform(-1.2, 1.2, 2)
            radius = width * random.uniform(0.5, 1.0, 2)
            low, high = bounds.bent(text, centre, radius, signs)
            x = centre + signs * radius
            true = eval(text, _FUNCTIONS, {"x0": x[:, 0], "x1": x[:, 1]})
            assert (low <= true + 1e-12).all(), (text, width)
            assert (true <= high + 1e-12).all(), (text, width)
            # Off the tangent plane at the centre, by differences of values around it.
            step = 1e-5
            values = [
                eval(text, _FUNCTIONS, {"x0": centre[0] + a, "x1": centre[1] + b})
                for a, b in ((0.0, 0.0), (step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step))
            ]
            tangent = np.array([values[1] - values[2], values[3] - values[4]]) / (2.0 * step)
            off = np.abs(true - values[0] - (x - centre) @ tangent).max()
            assert (high - low).max() <= times * off + 2.0 * width**3 + 1e-9, (
                text,
                width,
                (high - low).max(),
                off,
            )


def reductions(bounds: Bounds) -> None:
    """A set of fewer generators is around the other one, and not much larger."""
    random = np.random.default_rng(11)
    generators = random.normal(size=(2, 200)) * 0.95 ** np.arange(200)
    states = Set(random.normal(size=2), generators[:, random.permutation(200)])
    fewer = bounds.reduced(states)
    # Along the axes a box is exact.
    along = Set(states.centre, np.kron(np.ones(100), np.diag([0.1, 0.2])))
    np.testing.assert_allclose(bounds.reduced(along).highest(np.eye(2)), along.highest(np.eye(2)))
    directions = random.normal(size=(50, 2))
    assert (fewer.highest(directions) >= states.highest(directions) - 1e-12).all()
    span = np.abs(directions @ generators).sum(axis=1)
    assert (fewer.highest(directions) <= states.highest(directions) + 0.2 * span).all()
    assert fewer.generators.shape[1] <= 100
    # Whatever the axes are, what they leave out is added.
    with bounds.wrong_axes():
        assert (bounds.reduced(states).highest(directions) >= states.highest(directions)).all()
    # A loop that turns and shears a set and shrinks it slowly keeps new errors small. Along the states' own axes
    # they would grow more than a thousandfold.
    shear = np.array([[1.0, 10.0], [0.0, 1.0]])
    turn = np.array([[np.cos(0.05), -np.sin(0.05)], [np.sin(0.05), np.cos(0.05)]])
    loop = 0.98 * shear @ turn @ np.linalg.inv(shear)
    states = Set(np.zeros(2), np.zeros((2, 2)))
    exact = np.zeros(2)
    power = np.eye(2)
    for _ in range(300):
        generators = np.concatenate((loop @ states.generators, np.eye(2)), axis=1)
        states = bounds.reduced(Set(states.centre, generators))
        exact += np.abs(power).sum(axis=1)
        power = loop @ power
    assert (states.highest(np.eye(2)) < 3.0 * exact).all()


def options(bounds: Bounds) -> None:
    """Numbers that a network takes, the time at which a property begins, and the earliest time of an end."""
    name = "a pendulum"
    network = random_layers((3, 3, 1), 3, "tanh", 0.7)
    low = np.array([0.95, 0.1])
    high = np.array([1.0, 0.12])
    path = flown(
        name,
        network,
        Set.between(low, high).corners(60, np.random.default_rng(9)),
        5,
        lambda x: np.column_stack(
            (4.0 * x[:, 1] - 2.5, np.full(len(x), 0.3), 2.0 * x[:, 0] + x[:, 1])
        ),
    )
    # What is kept by 5 cm/s after two periods, and a box that flights are in after four, and neither before nor
    # at the end.
    kept = {"lower": [-9.0, float(path[2:, ..., 1].min()) - 0.05], "upper": [9.0, 9.0]}
    end = keep_text("end", around(path[3, -1], 0.03)) + "earliest = 3\n"
    text = problem_text(PLANTS[name], low, high, end + keep_text("within", kept), 5)
    text = 'begins = 2\ninputs = ["4 * x1 - 2.5", "0.3", "2 * x0 + x1"]\n' + text
    margin = bounds.flight(text, network, low, high)
    assert 0.005 <= margin <= 0.03 + 1e-9, margin
    # Without the beginning, the last instant alone, or the numbers it takes the property is another one.
    for old, new in (
        ("begins = 2\n", ""),
        ("earliest = 3\n", ""),
        ("earliest = 3\n", "earliest = 5\n"),
        ("x1 - 2.5", "x1 + 4.5"),
    ):
        assert old in text
        assert bounds.flight(text.replace(old, new), network, low, high) < 0.0, (old, new)


def covers(bounds: Checker) -> None:
    """Cells cover a box only if no point of it is left out."""
    random = np.random.default_rng(10)
    for count in (1, 2, 3):
        box = [(-1.0, 2.0)] * (count - 1) + [(0.5, 0.5) if count == 3 else (0.0, 1.0)]
        cells = [box]
        while len(cells) < 9:
            cell = cells.pop(int(random.integers(len(cells))))
            axis = int(random.integers(max(count - 1, 1)))
            low, high = cell[axis]
            cut = low + (high - low) * float(random.uniform(0.2, 0.8))
            cells += [[*cell[:axis], part, *cell[axis + 1 :]] for part in ((low, cut), (cut, high))]
        bounds.check._cover(box, cells)
        bounds.check._cover(box, [*cells[::-1], cells[0]])
        for k in range(len(cells)):
            axis = k % max(count - 1, 1)
            low, high = cells[k][axis]
            less = float(np.nextafter(high, low))
            smaller = [*cells[k][:axis], (low, less), *cells[k][axis + 1 :]]
            for rest in (cells[:k] + cells[k + 1 :], [*cells[:k], smaller, *cells[k + 1 :]]):
                with pytest.raises(bounds.refusals):
                    bounds.check._cover(box, rest)


def bent_line() -> tuple[list[Layer], np.ndarray, np.ndarray, np.ndarray]:
    """A network that bends within its starts on a line, their low and high ends, and velocities of flights."""
    hidden = Layer(np.array([[0.5, 6.0], [-4.0, 1.0]]), np.array([0.0, 0.5]), "tanh")
    network = [hidden, Layer(np.array([[3.0, 2.0]]), np.zeros(1), "tanh")]
    low = np.array([-1.0, 0.0])
    high = np.array([1.0, 1.5])
    x = Set.between(low, high).corners(300, np.random.default_rng(15))
    return network, low, high, flown("a line", network, x)[..., 1]


def halves(bounds: Checker) -> None:
    """A cell that is too wide as a whole is proved in parts, unless a part is false; then it is refused."""
    network, low, high, velocities = bent_line()
    for side, extreme, sign in (
        ("upper", float(velocities.max()), 1.0),
        ("lower", float(velocities.min()), -1.0),
    ):
        for spare, is_true in ((0.1, True), (-0.3, False)):
            limit = {"lower": [-99.0, -99.0], "upper": [99.0, 99.0]}
            limit[side][1] = extreme + sign * spare
            text = problem_text(PLANTS["a line"], low, high, keep_text("within", limit))
            assert bounds.flight(text, network, low, high) < 0.0
            margin = bounds.flight(text, network, low, high, depth=12)
            assert (0.0 < margin <= spare) if is_true else margin <= 0.0


IDENTICAL = ('["u0", "u1"]', 2, 0.1)
"""A plant x' = u of the states of `graphs`."""
LINE = problem_text(
    IDENTICAL,
    [-0.1, -1.0],
    [0.1, 1.0],
    keep_text("within", {"lower": [-0.4, -1.2], "upper": [0.4, 1.2]}),
    3,
)
"""Its network keeps it within the limits from these starts."""


def linear_network(shift: Any = (0.0, 0.0)) -> bytes:
    """The file of the network W x + shift."""
    return graph([step("Gemm", "x W b", "y", transB=1)], b=np.array(shift))


def certificate(network: bytes, problem: str, **claim: Any) -> bytes:
    """A certificate in words of its own."""
    digest = hashlib.sha256(network).hexdigest()
    return json.dumps({"format": 1, "network": digest, "problem": problem, **claim}).encode()


def verdicts(bounds: Checker) -> None:
    """True certificates are accepted with their least margin, and others refused."""
    network = linear_network()
    halves = [[[-0.1, -1.0], [0.0, 1.0]], [[0.0, -1.0], [0.1, 1.0]]]

    def claimed(problem: str, cells: Any = halves) -> bytes:
        return certificate(network, problem, cells=cells, margins=[0.1] * len(cells))

    honest = claimed(LINE)
    margin = bounds.check.check(honest, network)
    # The flights from the corners; x' = W x per period.
    x = np.array(list(itertools.product((-0.1, 0.0, 0.1), (-1.0, 1.0))))
    least = 1.2 - 1.0
    for _ in range(3):
        x = x + 0.1 * x @ WEIGHT.T.astype(float)
        least = min(least, 0.4 - np.abs(x[:, 0]).max(), 1.2 - np.abs(x[:, 1]).max())
    assert least - 0.03 <= margin <= least + 1e-9
    for content, file in (
        (honest, linear_network(SHIFT)),
        (claimed(LINE.replace("[-0.4, -1.2]", "[-0.11, -1.2]")), network),
        (claimed(LINE.replace("upper = [0.1, 1.0]", "upper = [0.2, 1.0]")), network),
        (claimed(LINE, halves[:1]), network),
        (claimed(LINE.replace("commands = 2", "commands = 1").replace('"u1"', '"-x1"')), network),
    ):
        with pytest.raises(bounds.refusals):
            bounds.check.check(content, file)
    assert bounds.check.check(honest, network, only=[1]) >= margin


BROKEN: dict[str, Callable[[float], dict[str, Any]]] = {
    "within": lambda by: {"lower": [-9.0, by - 2.0], "upper": [9.0, 9.0]},
    "avoid": lambda by: {"lower": [-9.0, -9.0], "upper": [9.0, by - 2.0]},
    "every": lambda by: {"rows": [[0.0, 1.0], [0.5, 0.0]], "offsets": [2.0 - by, 9.0]},
    "some": lambda by: {"rows": [[0.0, 0.0], [-1.0, 0.0]], "offsets": [-9.0, 2.0 - by]},
    "stay_in": lambda by: {"position": [0, 1], "radius": 2.0 - by},
    "keep_out": lambda by: {"position": [0, 1], "radius": by},
    "speed_limit": lambda by: {
        "position": [0],
        "velocity": [1, 0],
        "base": 2.0 - by,
        "slope": 0.1,
    },
    "end": lambda by: {"lower": [-9.0, by - 2.0], "upper": [9.0, 9.0]},
}
"""Limits, which a number leaves less of."""


def refutations(bounds: Checker) -> None:
    """A flight is accepted if it breaks the property at an instant, else, or if it is another one, refused."""
    network = linear_network()
    states = [np.array([0.1, -0.9])]
    for _ in range(3):
        states.append(states[-1] + 0.1 * WEIGHT.astype(float) @ states[-1])
    flight = np.array(states)
    other = flight + np.array([[0.0], [0.0], [1e-4], [0.0]])

    def verdict(limits: str, claimed: np.ndarray, least: float = -1.0) -> float:
        text = problem_text(IDENTICAL, [-0.1, least], [0.1, 1.0], limits, 3)
        try:
            return bounds.check.check(certificate(network, text, flight=claimed.tolist()), network)
        except bounds.refusals:
            return 0.0

    for keep, more in (*((keep, "") for keep in BROKEN), ("end", "earliest = 1\n")):
        of_states = true_margins(keep, BROKEN[keep](0.0), flight)
        kept = of_states.min()
        if keep == "end":
            kept = of_states[1:].max() if more else of_states[-1]
        limits = keep_text(keep, BROKEN[keep](float(kept) + 0.004)) + more
        assert abs(verdict(limits, flight) + 0.004) < 1e-6, limits
        assert verdict(keep_text(keep, BROKEN[keep](float(kept) - 0.004)) + more, flight) == 0.0
        assert verdict(limits, other) == 0.0, limits
        assert verdict(limits, flight, least=-0.5) == 0.0, limits


def proofs(bounds: Prover) -> None:
    """Proved cells fill the starts, and no flight from one has less than its margin; what is open is said to be."""
    network, low, high, velocities = bent_line()
    random = np.random.default_rng(14)
    # A limit that some cells keep as a whole, and the others in parts only, which may be too large to be allowed.
    for spare, smallest in ((0.03, 1.0 / 64), (0.03, 1.0), (-0.3, 1.0 / 64)):
        limit = {"lower": [-99.0, -99.0], "upper": [99.0, float(velocities.max()) + spare]}
        text = problem_text(PLANTS["a line"], low, high, keep_text("within", limit))
        problem = bounds.problem.problem_of(text)
        proof = bounds.proof.prove(problem, network, smallest=smallest, first=[2, 3])
        is_whole = spare > 0.0 and smallest < 1.0
        assert proof.is_whole == is_whole
        assert (proof.counterexample is None) == (spare > 0.0)
        assert (proof.margins > 0.0).all()
        if spare < 0.0:
            continue
        open_part = np.prod((proof.open_high - proof.open_low) / (high - low), axis=1).sum()
        assert (open_part == 0.0) == is_whole
        assert abs(proof.volume + open_part - 1.0) < 1e-12
        lowest = np.concatenate((proof.low, proof.open_low))
        highest = np.concatenate((proof.high, proof.open_high))
        start = random.uniform(low, high, (2000, 2))
        inside = (start[:, None] >= lowest) & (start[:, None] <= highest)
        assert np.any(np.all(inside, axis=2), axis=1).all()
        if is_whole:
            assert 6 < len(proof.low) < 400
        for k in range(0, len(proof.low), 7):
            x = random.uniform(proof.low[k], proof.high[k], (20, 2))
            path = flown("a line", network, x)
            assert proof.margins[k] <= true_margins("within", limit, path.reshape(-1, 2)).min()


PARTS: dict[str, Callable[[Any], None]] = {
    "enclosures": enclosures,
    "linear motions": linear_motions,
    "motions": motions,
    "explosions": explosions,
    "margins": margins,
    "flights": flights,
    "options": options,
    "reductions": reductions,
    "bends": bends,
}
"""Parts for both programs."""
OF_CHECKER: dict[str, Callable[[Any], None]] = {
    **PARTS,
    "covers": covers,
    "halves": halves,
    "verdicts": verdicts,
    "refutations": refutations,
}
OF_PROVER: dict[str, Callable[[Any], None]] = {**PARTS, "proofs": proofs}
