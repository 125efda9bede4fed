"""The backbone whose last layer demands a change of twist, which is then allocated to the craft's effectors.

Its weights are the same whatever effectors a craft has, and in whatever order. A network of it that is given the
authority of its craft (`rans_any_craft.authority`) flies any craft.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from torch import Tensor

from rans.extend import (
    AnyCraftBackbone,
    Architecture,
    Columns,
    ConfigError,
    Field,
    Layout,
    Program,
    Spacecraft,
    inputs,
    where,
)
from rans.policy.backbones import AnyCraft
from rans_any_craft.adaptation import Adaptation, estimator
from rans_any_craft.allocated import (
    ON_OFF,
    SHARED,
    SHUT,
    WHEELS,
    Filled,
    Tokens,
    checks,
    choice,
    continuous,
    effects_of,
    slopes_of,
    thruster_count,
    wheels,
    width,
)
from rans_any_craft.authority import DIMENSIONS, Authority, away, column_count, layout, of_body
from rans_any_craft.frugality import check_frugality, numbers_of
from rans_any_craft.holding import NUMBERS, Pulses, first, in_units, pose, pulses_of, worth
from rans_any_craft.imitation import imitate, teacher
from rans_any_craft.networks import effects, for_craft, frugal
from rans_any_craft.prospects import Prospect, slips, spared
from rans_any_craft.timing import PERIODS_IN_SPACE, timing_for

AWAY = "away"
"""Row of a program, (N, 1): 1 where the goal is far, else 0, of a policy whose price of thrust depends on it."""
POSE = "pose"
"""Row of a program, (N, 6): `rans_any_craft.holding.pose`, of a policy that holds it by pulses."""
_CHECK = 2
"""Control periods for which two opposite thrusters are open while they are checked: an estimator sees changes over
two periods."""
_UNBOUNDED = 100.0
"""Distance, m, that is as good as no bound: tasks fail before."""


class Allocated(AnyCraftBackbone):
    """The last layer's numbers are a demand in units of the craft's authority (`rans_any_craft.allocation`).

    They are three in the plane and six in space. A token is what an effector does to the twist in a control period
    in the same units, and its kind. Wheels turn the craft by what thrusters leave; where thrusters alone cannot
    push and turn it every way, both are allocated together.
    """

    @property
    def any_craft(self) -> AnyCraft:
        """See `Backbone`."""
        return AnyCraft(
            for_craft,
            frugal,
            observes,
            timing_for,
            PERIODS_IN_SPACE,
            Prospect.of,
            spared,
            slips,
            teacher,
            imitate,
        )

    def tokens(self, craft: Spacecraft, period: float) -> Tokens:
        """See `Backbone`."""
        if craft.is_continuous:
            raise ConfigError(
                f"the backbone 'allocated' opens on/off thrusters together, and {craft.name} has other effectors: "
                "leave out ppo.backbone."
            )
        return effects(craft, period)

    def check(self, architecture: Architecture) -> None:
        """See `Backbone`: sizes of tokens, then those of an agent for any craft."""
        if {*map(len, architecture.tokens)} not in ({4}, {7}) or (
            len(architecture.tokens) != architecture.thrusters
        ):
            raise ValueError("its tokens are of another spacecraft")
        check_frugality(architecture)
        reach = architecture.reach
        if reach and (len(architecture.authority) != 7 or len(reach) != 8 or min(reach) <= 0.0):
            raise ValueError(
                "its reach is not eight accelerations in the plane, or it is no agent for any craft"
            )
        if architecture.authority:
            columns = self.columns(architecture)  # refuses the observations of another task
            if architecture.filters or architecture.symmetries:
                raise ValueError(
                    "it has symmetries or filters, which are for columns without authority"
                )
            if architecture.adapts and architecture.recalled:
                raise ValueError("it adapts, and has another memory")
            dimension = DIMENSIONS.get(len(architecture.authority) - 1, 0)
            is_positive = all(x > 0.0 for x in architecture.authority)
            if column_count(dimension) != columns.width or not is_positive:
                raise ValueError(
                    "its authority is not a control period and six accelerations, or twelve in space, above 0"
                )
        elif architecture.adapts:
            raise ValueError("it adapts, but knows no authority of its spacecraft")
        if architecture.filling:
            turning = len(wheels(architecture.tokens))
            is_positive = all(x > 0.0 for x in architecture.filling)
            if not architecture.adapts or len(architecture.filling) != turning or not is_positive:
                raise ValueError(
                    "its filling is not a number above 0 for each wheel of one that adapts"
                )

    def columns(self, architecture: Architecture) -> Layout:
        """See `Backbone`."""
        return layout(architecture.layout) if architecture.authority else architecture.layout.body

    def preprocessed(self, architecture: Architecture, observation: Columns) -> list[Field]:
        """See `Backbone`."""
        body = architecture.layout.in_body(observation)
        if architecture.adapts or not architecture.authority:
            return body
        return self.adapted(architecture, body, (1.0, 1.0), 0.0)

    def known(self, architecture: Architecture, columns: Columns) -> dict[str, list[Field]]:
        """See `Backbone`: whether the goal is far, and the pose where pulses hold it."""
        numbers = numbers_of(architecture)
        result = {}
        if numbers.away != 1.0:
            dimension = DIMENSIONS[len(architecture.authority) - 1]
            result[AWAY] = [away(columns, dimension)]
        if numbers.hold:
            result[POSE] = pose(columns)
        return result

    def adaptation(self, architecture: Architecture) -> Adaptation:
        """See `Backbone`."""
        return estimator(
            architecture.tokens,
            architecture.authority,
            architecture.farthest_lost > 0.0,
            architecture.filling,
            _has_checks(architecture),
        )

    def adapted(
        self, architecture: Architecture, read: Columns, gains: Columns, lost: Field
    ) -> list[Field]:
        """See `Backbone`."""
        own = Authority.of_numbers(architecture.authority, architecture.reach)
        farthest: tuple[Field, Field] | None = None
        if (gentle := _gentle(architecture, lost)) is not None:
            distance: Field = architecture.farthest or _UNBOUNDED
            if architecture.farthest_lost:
                distance = distance + lost * (architecture.farthest_lost - distance)
            farthest = distance, gentle
        return of_body(
            architecture.layout,
            read,
            own.faster(*gains),
            architecture.coast,
            farthest,
            numbers_of(architecture),
        )

    def for_faults(self, architecture: Architecture) -> Architecture:
        """See `Backbone`: pulses that count on every thruster hold no pose."""
        numbers = numbers_of(architecture)
        if not numbers.hold:
            return architecture
        return replace(architecture, frugal=tuple(numbers._replace(hold=0.0)))

    def choices(self, architecture: Architecture) -> int:
        """See `Backbone`."""
        chosen = choice(architecture.tokens, architecture.adapts, numbers_of(architecture).price)
        return 0 if chosen is None else len(chosen.offset)

    def rows(self, architecture: Architecture) -> int:
        """See `Backbone`."""
        return architecture.last.weights * width(architecture.tokens)

    def tables(self, architecture: Architecture, like: Tensor) -> tuple[Tensor, ...]:
        """See `Backbone`: for a network that learns for its own craft, which has on/off thrusters alone."""
        kinds = {token[-1] for token in architecture.tokens}
        if architecture.authority or not kinds <= {ON_OFF, SHARED}:
            return ()
        chosen = choice(architecture.tokens, price=numbers_of(architecture).price)
        assert chosen is not None
        return tuple(map(like.new_tensor, (chosen.offset, chosen.slope.T, chosen.opened)))

    def traced(self, program: Program, architecture: Architecture, features: str) -> str:
        """Shares or log-odds, of features and rows of what is known; see `Backbone`."""
        size = width(architecture.tokens)
        numbers = numbers_of(architecture)
        demand = program.dense(features, "head", size, architecture.features)
        symbols = inputs("demand", size)
        chosen = choice(architecture.tokens, architecture.adapts, numbers.price)
        if chosen is None:
            return self._continuous(program, architecture, demand)
        # The best subset is the largest of linear functions.
        factor = numbers.away
        more = [AWAY] * (factor != 1.0) + [SHUT] * architecture.adapts
        known = program.joined(demand, *more) if more else demand
        slopes = program.constant(slopes_of(chosen, architecture.adapts, factor), "subset_slopes")
        product_ = program.apply("MatMul", known, slopes)
        offset = program.constant(chosen.offset, "subset_offsets")
        best = program.apply("ArgMax", program.apply("Add", product_, offset), axis=1, keepdims=0)
        turning = wheels(architecture.tokens)
        count = chosen.opened.shape[1]
        if not turning:
            table = program.constant(effects_of(chosen)[:, :count], "subsets")
            opened = program.apply("Gather", table, best, axis=0)
            if not numbers.hold:
                return opened
            return _held(program, opened, _pulses(architecture.tokens, architecture.authority))
        table = program.constant(effects_of(chosen), "subsets")
        row = program.apply("Gather", table, best, axis=0)
        opened, twist = program.split(row, (count, size))
        half = program.constant(0.5)
        pairs = zip(program.single(demand, size), program.single(twist, size), strict=True)
        left = [program.apply("Sub", a, b) for a, b in pairs]
        commands = program.lowered(
            continuous(symbols, turning), dict(zip(symbols, left, strict=True))
        )
        return program.joined(program.apply("Add", opened, half), *commands)

    def _continuous(self, program: Program, architecture: Architecture, demand: str) -> str:
        """Write commands for a row of demands where no thruster is on/off; see `traced`."""
        symbols = inputs("demand", width(architecture.tokens))
        names = dict(zip(symbols, program.single(demand, len(symbols)), strict=True))

        def known(name: str, row: str, count: int) -> list[Field]:
            """Numbers of a row of what is known."""
            numbers = inputs(name, count)
            names.update(zip(numbers, program.single(row, count), strict=True))
            return [*numbers]

        limits, some = None, 0.0
        if architecture.adapts:
            lost = known("lost", SHUT, thruster_count(architecture.tokens))
            limits, some = [1.0 - x for x in lost], sum(lost)
        remembered = []
        if architecture.filling:
            remembered = known("wheel", WHEELS, len(architecture.filling) + 1)
        commands = continuous(
            symbols,
            architecture.tokens,
            limits,
            _gentle(architecture, some),
            list(map(Filled, remembered[:-1], architecture.filling)),
            numbers_of(architecture).price,
        )
        if _has_checks(architecture):
            commands = _checked(commands, architecture.tokens, remembered[-1])
        return program.joined(*program.lowered(commands, names))


@lru_cache(maxsize=64)
def _pulses(tokens: Tokens, authority: tuple[float, ...]) -> Pulses:
    """Pulses by which a craft holds its pose."""
    chosen = choice(tokens)
    assert chosen is not None
    # An offset is minus the squared twist and minus the price of the thrust.
    thrust = -chosen.offset - np.square(chosen.twist).sum(axis=1)
    period, *ways = authority
    square = period * period
    units = min(ways[:4]) * square, min(ways[4:]) * square
    return pulses_of(chosen.opened, chosen.twist, thrust, units, period)


def _mixed(opened: Field, held: Field, is_network: Field) -> Field:
    """What the network opens where a flag is 1, else what holds the pose."""
    return is_network * opened + (1.0 - is_network) * held


def _held(program: Program, opened: str, pulses: Pulses) -> str:
    """Thrusters of a craft that holds its pose by pulses (`POSE`), or ``opened`` of the network."""
    symbols = inputs("pose", NUMBERS)
    names = dict(zip(symbols, program.single(POSE, NUMBERS), strict=True))
    own = program.lowered(in_units(symbols, pulses), names)

    def pulse(*numbers: Field) -> Field:
        state, (*twist, thrust) = numbers[:NUMBERS], numbers[NUMBERS:]
        return worth(state, twist, thrust, pulses.radius, pulses.angle)

    tables = [program.constant(column) for column in (*pulses.twist.T, pulses.thrust)]
    others = program.lowered(first(symbols, pulses), names)
    scores = program.joined(*others, program.each(pulse, *own, *tables))
    best = program.apply("ArgMax", scores, axis=1, keepdims=0)
    row = program.apply("Gather", program.constant(pulses.table, "pulses"), best, axis=0)
    held, is_network = program.split(row, (pulses.table.shape[1] - 1, 1))
    return program.each(_mixed, opened, held, is_network)


def _gentle(architecture: Architecture, lost: Field) -> Field | None:
    """Whether wheels take up momentum with the speed, 1 or 0; None: they never do. ``lost``: of a thruster."""
    if architecture.farthest:
        return 1.0
    return lost if architecture.farthest_lost and architecture.adapts else None


def _checked(commands: list[Field], tokens: Tokens, periods: Field) -> list[Field]:
    """Commands, or in the first periods those that check thrusters.

    A lost thruster is then known before the craft is faster than it can be stopped by the others.
    """
    groups = checks(tokens)
    checked: list[Field] = [0.0] * thruster_count(tokens) + [0.5] * len(wheels(tokens))
    for number, group in enumerate(groups):
        first = _CHECK * number
        for k in group:
            checked[k] = where(periods < first, 0.0, where(periods < first + _CHECK, 1.0, 0.0))
    ending = float(_CHECK * len(groups))
    return [
        where(periods < ending, check, command)
        for command, check in zip(commands, checked, strict=True)
    ]


def _has_checks(architecture: Architecture) -> bool:
    """Whether a policy checks its thrusters: it remembers momenta, and would fly too fast without one of them."""
    return bool(architecture.filling) and not architecture.farthest


def observes(observed: Layout) -> bool:
    """Whether the observations of a layout have what a network for any craft is given."""
    try:
        layout(observed)
    except ConfigError:
        return False
    return True


ALLOCATED = Allocated()
