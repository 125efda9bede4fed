"""Estimates in flight of what no file states: a lost thruster, and how strongly the thrusters accelerate the craft.

One hypothesis is that every thruster works; each further one, that a thruster which the craft can spare is almost
dead. A hypothesis has two gains, over the accelerations of the file: of velocities and of angular velocities. A
heavier craft has smaller gains. Each hypothesis predicts the change of the twist over two control periods, by the
commands of these. Its gains follow by recursive least squares, and its odds by the likelihood of the readings
(Magill, "Optimal adaptive estimation of sampled stochastic processes", 1965).

A command answers a reading with its noise, so that the noise of the reading before the command would look like an
effect of it. Therefore the change is taken from the reading one period earlier, and only the last command corrects
the gains: it is the instrument of the regression (Young, "Recursive estimation and time-series analysis", 1984).
Sequences of fields (N,) hold one entry an axis of the twist; the traced program of the policy prints the same
functions, so only arithmetic on fields is allowed.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple, TypeVar

import numpy as np

from rans.extend import Field, Rows, at_least, vector_in_rotated_frame, where, within
from rans.model.fields import log
from rans.policy.adaptation import Estimate
from rans_any_craft.allocated import SHARED, SHUT, WHEELS, spare, wheels
from rans_any_craft.authority import Authority
from rans_any_craft.twists import directions

Row = TypeVar("Row")

_WEAK = 0.2
"""Part of its force that a lost thruster gives by hypothesis: a weak one is nearer to it than to a sound one."""
_HALF = 0.5
"""Part of its force that a weak thruster gives by a hypothesis of its own, by which it stays in use."""
_NOISE = 0.0045
"""Standard deviation of the difference of two readings, m/s and rad/s."""
_MODEL = 0.15
"""Part of the predicted change of twist that a craft of the file's values may deviate from it."""
_EACH = 0.15
"""Part by which the effect of each effector may deviate, independently of the others: effects that cancel each
other, such as those of thrusters and of wheels that balance them, do not cancel their errors."""
_LATE = 0.25
"""Part of the effect of a command that may come a control period later."""
_SPREAD = 0.4**2
"""Prior variance of the gains."""
_WANDER = 1e-4
"""Variance that the gains gain in every control period: a converged estimate still follows a later change."""
_GAINS = 0.25, 2.5
"""Range of the gains: masses from 0.5 to 2 times that of the file, with a droop of shared supplies."""
_OUTLIER = 9.0
"""Largest squared deviation, in standard deviations, that counts against a hypothesis."""
_OVERLAP = 0.5
"""Weight of a likelihood: every reading is in two differences."""
_FORGOTTEN = 0.99
"""Part of the odds that stays from period to period."""
_REMEMBERED = 0.998
"""Part of the odds that stays from period to period where thrusters are checked at the start: a lost one must not
be tried again near the goal. At 0.99 45 % of 64 flights of cubesat-6u with a dead thruster settle, at 0.998 and at
1 69 %."""
_ODDS = -6.0, 20.0
"""Range of the logarithm of the odds of a lost thruster over none."""
_MOST_PERIODS = 1e4
"""Number up to which control periods since the start are counted; checks of thrusters end before."""
_EVIDENCE = 4.0
"""Logarithm of the odds beyond which a thruster stays shut."""
_EVIDENCE_OF_CHECKS = 1.0
"""Logarithm of the odds of a lost over a weak thruster beyond which it stays shut, where thrusters are checked at
the start: a lost one that is taken for a weak one loses the flight. At 0 more flights of CubeSats with a weak
thruster are lost, at 2 more with a dead one (docs/decisions/any_craft.md)."""


class Adaptation(NamedTuple):
    """Estimator of one spacecraft.

    Its memory is (N, width): two twists, two commands, of every hypothesis two gains, their variances and the
    logarithm of its odds, and the momenta of wheels with the number of periods. Zeros are the memory where an
    episode begins.
    """

    period: float
    """Control period, s."""
    effects: tuple[tuple[float, ...], ...]
    """(commands, d) change of the twist in a period by each thruster, then by each wheel one way, m/s and rad/s."""
    thrusters: int
    is_shared: bool
    """Whether each open thruster gives 1 over their number of its force."""
    spare: tuple[int, ...]
    """Numbers of the thrusters without which the others push and turn the craft every way."""
    weak: tuple[int, ...] = ()
    """Numbers of those that stay in use with half of their force: without one the craft is slow."""
    filling: tuple[float, ...] = ()
    """Part of the momentum at which a wheel is full that its full command adds in a period, for every wheel whose
    momentum is remembered; empty: none is."""
    has_checks: bool = False
    """Whether the policy checks the thrusters at the start of an episode."""

    @property
    def twist(self) -> int:
        """Numbers of a twist, with which a reading in B begins."""
        return len(self.effects[0])

    @property
    def _hypotheses(self) -> int:
        return 1 + len(self.spare) + len(self.weak)

    def _works(self) -> np.ndarray:
        """Part of its effect that each effector gives by every hypothesis, (commands, hypotheses)."""
        works = np.ones((len(self.effects), self._hypotheses))
        parts = [(k, _WEAK) for k in self.spare] + [(k, _HALF) for k in self.weak]
        for hypothesis, (thruster, part) in enumerate(parts, start=1):
            works[thruster, hypothesis] = part
        return works

    @property
    def width(self) -> int:
        """Numbers of the memory."""
        return sum(self._widths())

    def _widths(self) -> list[int]:
        pairs = [self.twist] * 2 + [len(self.effects)] * 2
        return pairs + [self._hypotheses] * 5 + self._remembered

    @property
    def known(self) -> dict[str, int]:
        """See `rans.policy.adaptation.Adaptation`."""
        widths = {SHUT: self.thrusters}
        return widths | {WHEELS: len(self.filling) + 1} if self.filling else widths

    @property
    def _remembered(self) -> list[int]:
        """Numbers of `rans_any_craft.allocated.WHEELS`, if there are any."""
        return [len(self.filling) + 1] if self.filling else []

    def estimated(self, rows: Rows[Row], twist: Row, memory: Row) -> Estimate[Row]:
        """Estimate after a reading of the twist (N, d) in B, and the memory (N, width) of the period before.

        The order of the memory is in agents' files; the traced program and torch run these lines alike.
        """
        size = self.twist
        earlier, latest, last, previous, *rest = rows.split(memory, self._widths())
        beliefs, odds, remembered = rest[:4], rest[4], rest[5:]

        # Change of the twist over two periods, both readings in the present B; the reading between, in B as well.
        now, before, between = (rows.split(row, [1] * size) for row in (twist, earlier, latest))
        # Before the first reading there was none: as if the craft had moved as it does now.
        variance = beliefs[2]
        first, *_ = rows.split(variance, [1] * self._hypotheses)
        moved = rows.computed(self._moved, [*now, *before, *between, first])
        changes = moved[:size]
        latest = rows.joined(moved[size:])

        # What the last two commands do by each hypothesis.
        newer, older = (self._effects(rows, command) for command in (last, previous))
        squares = [self._squares(rows, command) for command in (last, previous)]
        (scatter,) = rows.computed(lambda a, b: [a + b], squares)
        scatters = rows.split(scatter, [1] * size)
        *beliefs, likelihood = rows.computed(
            self._learnt, [*changes, *newer, *older, *scatters, *beliefs]
        )
        gains = beliefs[:2]
        if not self.spare:
            shut = rows.product(beliefs[0], np.zeros((1, self.thrusters)))
        else:
            none = np.eye(self._hypotheses)[:, :1]
            of_none = rows.product(likelihood, none)
            stays = rows.constant([_REMEMBERED if self.has_checks else _FORGOTTEN])
            (odds,) = rows.computed(_weighed, [odds, likelihood, of_none, variance, stays])
            gains, shut = self._accepted(rows, odds, gains)
        if len(self.effects) > self.thrusters:
            # A wheel at the limit of its momentum gives no torque, and its momentum is not observed: with wheels
            # the gain of velocities stands for both.
            gains = [gains[0], gains[0]]
        memory = rows.joined([latest, twist, last, *beliefs, odds, *remembered])
        return Estimate(gains, shut, [shut, *remembered], memory)

    def _accepted(self, rows: Rows[Row], odds: Row, gains: Sequence[Row]) -> tuple[list[Row], Row]:
        """Both gains, (N, 1) each, and shut thrusters (N, thrusters) by the most probable hypothesis.

        Those with every thruster in use are preferred up to a limit of the odds.
        """
        shuts = self._works()[: self.thrusters] == _WEAK
        favour = np.where(shuts.any(axis=0), 0.0, _EVIDENCE)
        if self.has_checks:
            favour[1:] = np.minimum(favour[1:], _EVIDENCE_OF_CHECKS)
        (favoured,) = rows.computed(lambda a, b: [a + b], [odds, rows.constant(favour)])
        accepted = rows.largest(favoured, self._hypotheses)
        parts = rows.computed(lambda a, *b: [a * x for x in b], [accepted, *gains])
        every = np.ones((self._hypotheses, 1))
        return [rows.product(part, every) for part in parts], rows.product(accepted, 1.0 * shuts.T)

    def next_memory(self, rows: Rows[Row], estimate: Row, command: Row) -> Row:
        """Memory after an estimate (`Estimate.memory`) and a command from 0 to 1.

        A wheel's command of 0.5 is no torque, and is remembered as 0.
        """
        widths = [2 * self.twist, len(self.effects), 5 * self._hypotheses, *self._remembered]
        twists, last, beliefs, *remembered = rows.split(estimate, widths)
        if len(self.effects) > self.thrusters:
            # Half of a wheel's command is no torque.
            wheels = np.arange(len(self.effects)) >= self.thrusters
            scale = rows.constant(1.0 + wheels)
            zero = rows.constant(1.0 * wheels)
            (command,) = rows.computed(lambda u, a, b: [u * a - b], [command, scale, zero])
        if remembered:
            count = len(self.filling)
            _, *turning = rows.split(command, [self.thrusters, *[1] * count])
            wheels = rows.split(remembered[0], [1] * (count + 1))
            remembered = rows.computed(self._after, [*wheels, *turning])
        return rows.joined([twists, command, last, beliefs, *remembered])

    def _after(self, *numbers: Field) -> list[Field]:
        """Momenta (shares of wheels' capacities) and number of periods, of those a period before and commands."""
        count = len(self.filling)
        wheels = zip(numbers[:count], self.filling, numbers[count + 1 :], strict=True)
        filled = [
            within(momentum + part * command, -1.0, 1.0) for momentum, part, command in wheels
        ]
        return [*filled, within(numbers[count] + 1.0, 0.0, _MOST_PERIODS)]

    def _effects(self, rows: Rows[Row], command: Row) -> list[Row]:
        """Change of the twist by a command along each axis, by every hypothesis, (N, hypotheses) each.

        Hypotheses come in the order of `_works`, that of all thrusters working first.
        """
        columns = np.array(self.effects)
        works = self._works()
        table = [column[:, None] * works for column in columns.T]
        effects = rows.split(
            rows.product(command, np.hstack(table)), [self._hypotheses] * self.twist
        )
        if not self.is_shared:
            return effects
        # A thruster that is lost takes nothing of the supply.
        opened = (works == 1.0) * (np.arange(len(columns)) < self.thrusters)[:, None]
        number = rows.product(command, opened)
        return rows.computed(lambda n, *x: [a / at_least(n, 1.0) for a in x], [number, *effects])

    def _squares(self, rows: Rows[Row], command: Row) -> Row:
        """Sum over all effectors of the squared change of the twist by each, (N, d), for a command (N, effectors).

        Where thrusters share a supply, changes are divided by the number of open ones.
        """
        (square,) = rows.computed(lambda u: [u * u], [command])
        squares = rows.product(square, np.square(self.effects))
        if not self.is_shared:
            return squares
        thrusters = np.arange(len(self.effects)) < self.thrusters
        number = rows.product(command, 1.0 * thrusters[:, None])
        return rows.computed(lambda s, n: [s / at_least(n * n, 1.0)], [squares, number])[0]

    def _moved(self, *numbers: Field) -> list[Field]:
        """Change of the twist since the reading before the last, then the last reading in the present B.

        The numbers are the twists of three readings and a variance that is 0 at the first one. It has no reading
        before it, so that the last one is itself.
        """
        size = self.twist
        *twists, variance = numbers
        now, before, between = (twists[k * size : (k + 1) * size] for k in range(3))
        pushing = directions(size)
        spins = zip(now[pushing:], between[pushing:], strict=True)
        # Half of the turn of B in the last period.
        half_turn = [0.25 * self.period * (a + b) for a, b in spins]
        before, between = (
            [*vector_in_rotated_frame(twist[:pushing], half_turn), *twist[pushing:]]
            for twist in (before, between)
        )
        last = (where(variance == 0.0, a, b) for a, b in zip(now, between, strict=True))
        return [*(a - b for a, b in zip(now, before, strict=True)), *last]

    def _learnt(self, *numbers: Field) -> list[Field]:
        """Gains and their variances after a reading, and its log-likelihood.

        Args:
            numbers: changes of the twist over two periods (d,), what the last command does by the hypothesis (d,),
                what the one before does (d,), sums of the squares of what every effector does by both (d,), gains
                of velocities and of angular velocities, and their variances.
        """
        size = self.twist
        pushing = directions(size)
        changes, newer, older, scatters = (numbers[k : k + size] for k in range(0, 4 * size, size))
        gains, variances = numbers[4 * size :][:2], numbers[4 * size :][2:]
        is_first = variances[0] == 0.0
        deviations: Field = 0.0
        spread: Field = 1.0
        after: list[tuple[Field, Field]] = []
        for gain, variance, axes in (
            (gains[0], variances[0], range(pushing)),
            (gains[1], variances[1], range(pushing, size)),
        ):
            information: Field = 0.0
            correction: Field = 0.0
            for axis in axes:
                latest = newer[axis]
                both = latest + older[axis]
                error = changes[axis] - gain * both
                late = _LATE * _LATE * (latest * latest + older[axis] * older[axis])
                own = _MODEL * _MODEL * both * both + _EACH * _EACH * scatters[axis]
                noise = _NOISE * _NOISE + own + late
                information = information + both * latest / noise
                correction = correction + latest * error / noise
                total = noise + variance * both * both
                deviations = deviations + within(error * error / total, 0.0, _OUTLIER)
                # In units of the noise, so that a product of six stays within single precision.
                spread = spread * (total * (1.0 / _NOISE**2))
            # Opposite commands give no information about a gain.
            certain = variance / (1.0 + variance * at_least(information, 0.0))
            after.append((within(gain + certain * correction, *_GAINS), certain + _WANDER))
        likelihood = -0.5 * _OVERLAP * (deviations + log(spread))
        (linear, linear_variance), (angular, angular_variance) = after
        prior = (1.0, 1.0, _SPREAD, _SPREAD)
        learnt = (linear, angular, linear_variance, angular_variance)
        begun = [where(is_first, first, x) for first, x in zip(prior, learnt, strict=True)]
        return [*begun, likelihood]


@lru_cache(maxsize=64)
def estimator(
    tokens: tuple[tuple[float, ...], ...],
    authority: tuple[float, ...],
    keeps_weak: bool,
    filling: tuple[float, ...],
    has_checks: bool,
) -> Adaptation:
    """Estimator of a spacecraft, for a policy that adapts.

    Effects are changes of the twist in a control period, m/s and rad/s, by a full command. Files of agents have
    tokens and authority, and rebuild the estimator from them.

    Args:
        tokens: one row for each command, its accelerations over the craft's least ones and then its kind; see
            `rans_any_craft.networks.effects`. Thrusters with a shared supply are all of the kind `SHARED`.
        authority: control period and accelerations; see `rans.policy.architecture.Architecture.authority`.
        keeps_weak: whether a thruster with half of its force stays in use.
        filling: see `rans.policy.architecture.Architecture`.
        has_checks: see `Adaptation`.
    """
    own = Authority.of_numbers(authority)
    columns = np.array(tokens)[:, :-1]
    pushing = directions(columns.shape[1])
    scale = np.repeat([own.least_linear, own.least_angular], [pushing, columns.shape[1] - pushing])
    effects = own.period * scale * columns
    return Adaptation(
        float(own.period),
        tuple(map(tuple, effects.tolist())),
        len(tokens) - len(wheels(tokens)),
        tokens[0][-1] == SHARED,
        spare(tokens),
        spare(tokens) if keeps_weak else (),
        filling,
        has_checks,
    )


def _weighed(
    odds: Field, likelihood: Field, of_none: Field, variance: Field, stays: Field
) -> list[Field]:
    """Logarithm of the odds of a hypothesis over that of no lost thruster, after a reading.

    The variance is that of a gain before the reading, 0 at the first one; a part of the odds ``stays``.
    """
    low, high = _ODDS
    return [where(variance == 0.0, 0.0, within(stays * odds + likelihood - of_none, low, high))]
