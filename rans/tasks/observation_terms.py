"""Observations as typed terms: their types give width, table, frames, mirror images and targets.

The paper's observation (section 3.2) is one layout of it: attitude, velocity, spin, task flag, then four
columns of task data in the plane and nine in space. A task with more to say has more columns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

from rans.errors import ConfigError
from rans.model.fields import Attitude, Field, Vec3, Vector, where

Dimension = Literal[2, 3]
Columns = Sequence[Field]
Turned = Callable[[Columns], Columns]
"""Two or three columns of a vector, to the same vector in other coordinates."""


class Column(NamedTuple):
    """One row of the table of an observation."""

    name: str
    unit: str
    frame: str


@dataclass(frozen=True)
class ObservationTerm:
    """One term of an observation; its kind says how its columns change with the frame and in a mirror."""

    name: str
    """First part of the names of its columns."""
    unit: str
    value: Field | tuple[Field, ...] | Vector | Attitude

    frame: ClassVar[str] = "-"
    bound: ClassVar[float] = float("inf")
    """Largest absolute value of its columns."""

    def columns(self) -> Columns:
        """Fields of its columns, in order."""
        if isinstance(self.value, Vector | Attitude):
            return self.value.columns()
        return self.value if isinstance(self.value, tuple) else (self.value,)

    def labels(self) -> Sequence[str]:
        """Name of each column."""
        return (self.name,)

    def table(self) -> Iterator[Column]:
        """Name, unit and frame of each column."""
        return (Column(label, self.unit, self.frame) for label in self.labels())

    def target(self) -> Columns:
        """Values of its columns at the goal of the task."""
        return (0.0,) * len(self.columns())

    def block(self) -> Block:
        """Kind and width of the term, without its values."""
        return Block(type(self), len(self.columns()))

    @staticmethod
    def in_body(columns: Columns, turned: Turned) -> Columns:
        """The columns in B, where ``turned`` takes vectors from W to B."""
        return columns

    @staticmethod
    def mirrored(columns: Columns, view: Turned, hand: Field) -> Columns:
        """The columns of B from an equivalent side, where ``hand`` is -1 for a mirror image."""
        return columns


@dataclass(frozen=True)
class VectorInW(ObservationTerm):
    """A vector expressed in W; policies receive it in B."""

    value: Vector
    frame = "W"

    def labels(self) -> Sequence[str]:
        """See `ObservationTerm`."""
        return [self.name + axis for axis in "xyz"[: len(self.columns())]]

    @staticmethod
    def in_body(columns: Columns, turned: Turned) -> Columns:
        """See `ObservationTerm`."""
        return turned(columns)

    @staticmethod
    def mirrored(columns: Columns, view: Turned, hand: Field) -> Columns:
        """See `ObservationTerm`."""
        return view(columns)


@dataclass(frozen=True)
class AngularVelocity(ObservationTerm):
    """An angular velocity in B; a mirror image reverses its sense."""

    value: tuple[Field, ...]
    frame = "B"

    def labels(self) -> Sequence[str]:
        """See `ObservationTerm`."""
        return [f"{self.name}_{axis}" for axis in ("z" if len(self.value) == 1 else "xyz")]

    @staticmethod
    def mirrored(columns: Columns, view: Turned, hand: Field) -> Columns:
        """See `ObservationTerm`."""
        return [x * hand for x in (columns if len(columns) == 1 else view(columns))]


@dataclass(frozen=True)
class RelativeRotation(ObservationTerm):
    """A rotation from B, R_B^T R of something, such as the rotation still to go to the goal's attitude."""

    value: Attitude
    bound = 1.0
    matrix: ClassVar[str] = "R"
    """Its symbol."""

    def labels(self) -> Sequence[str]:
        """See `ObservationTerm`."""
        if len(self.columns()) == 2:
            return [f"cos {self.name}heading", f"sin {self.name}heading"]
        return [f"{self.name}{self.matrix}[{i},{j}]" for i in (0, 1) for j in (0, 1, 2)]

    def table(self) -> Iterator[Column]:
        """See `ObservationTerm`: a heading's difference has no frame, a matrix of R_B^T R has rows in B."""
        frame = "B" if type(self) is RelativeRotation and len(self.columns()) > 2 else self.frame
        return (row._replace(frame=frame) for row in super().table())

    def target(self) -> Sequence[float]:
        """See `ObservationTerm`: no rotation."""
        return (1.0, 0.0) if len(self.columns()) == 2 else (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)

    @staticmethod
    def mirrored(columns: Columns, view: Turned, hand: Field) -> Columns:
        """The first two rows of G R G^T, where G is the view and the columns are the first two rows of R."""
        if len(columns) == 2:
            return [columns[0], columns[1] * hand]
        turned = [view(column) for column in zip(*matrix_rows(columns), strict=True)]
        return [x for row in list(zip(*turned, strict=True))[:2] for x in view(row)]


@dataclass(frozen=True)
class OwnRotation(RelativeRotation):
    """R_WB: what takes vectors to B, where nothing but they depends on it (decision 004)."""

    frame = "W"
    matrix = "R_WB"

    @staticmethod
    def in_body(columns: Columns, turned: Turned) -> Columns:
        """Nothing is left of it."""
        return ()


@dataclass(frozen=True)
class Scalar(ObservationTerm):
    """A number that does not depend on frame or handedness."""


@dataclass(frozen=True)
class TradeOff(Scalar):
    """A trade-off between objectives, 0 to 1, that an episode sets; no command can change it."""

    bound = 1.0

    def target(self) -> Columns:
        """See `ObservationTerm`."""
        return self.columns()


@dataclass(frozen=True)
class Information(Scalar):
    """A number that a policy should know, such as a margin, and that has no value to be driven to."""

    def target(self) -> Columns:
        """See `ObservationTerm`: whatever it is."""
        return self.columns()


@dataclass(frozen=True)
class InformationInW(VectorInW):
    """A vector in W that a policy should know, such as the way to a zone, without a value to be driven to."""

    def target(self) -> Columns:
        """See `ObservationTerm`: whatever it is."""
        return self.columns()


@dataclass(frozen=True)
class TaskDependent(ObservationTerm):
    """Columns whose kind depends on the task flag: those of the task that an episode drew."""

    value: tuple[Field, ...]
    choices: tuple[Choice, ...] = ()

    def labels(self) -> Sequence[str]:
        """See `ObservationTerm`."""
        return [f"{self.name} {i}" for i in range(len(self.value))]

    def target(self) -> Sequence[float]:
        """Refused (`ConfigError`): there is none that all tasks share."""
        raise ConfigError(
            "a multi-task's data have no target that its tasks share: name one of them."
        )

    def block(self) -> Block:
        """See `ObservationTerm`."""
        return Block(TaskDependent, len(self.value), self.choices)


class Block(NamedTuple):
    """Neighbouring columns of one term, without their values; `TaskDependent` has choices."""

    kind: type[ObservationTerm]
    width: int
    choices: tuple[Choice, ...] = ()

    def mirrored(self, columns: Columns, view: Turned, hand: Field, flag: Field) -> Columns:
        """The columns of B from an equivalent side, under this task flag."""
        result = self.kind.mirrored(columns, view, hand)
        for choice, blocks in self.choices:
            seen = [
                x
                for block, mine in Layout(blocks).split(columns)
                for x in block.mirrored(mine, view, hand, flag)
            ]
            result = [where(flag == choice, a, b) for a, b in zip(seen, result, strict=True)]
        return result


Choice = tuple[float, tuple[Block, ...]]
"""A task flag, and what the columns are under it."""


class Layout(NamedTuple):
    """Which columns are what: of attitude, velocity, spin, task flag and data; saved with every policy."""

    blocks: tuple[Block, ...]

    @property
    def width(self) -> int:
        """Number of columns."""
        return sum(block.width for block in self.blocks)

    @property
    def body(self) -> Layout:
        """The layout of what `in_body` gives."""
        return Layout(tuple(block for block in self.blocks if block.kind is not OwnRotation))

    def split(self, columns: Columns) -> Iterator[tuple[Block, Columns]]:
        """The columns of each block."""
        start = 0
        for block in self.blocks:
            yield block, columns[start : start + block.width]
            start += block.width

    def in_body(self, columns: Columns) -> list[Field]:
        """Columns of an observation with vectors in B, without the attitude: `body`."""
        turned = to_body(columns[: self.blocks[0].width])
        return [x for block, mine in self.split(columns) for x in block.kind.in_body(mine, turned)]

    def ahead(self, columns: Columns) -> Columns | None:
        """The first vector among the task's data, of `body`'s columns: the way to go, if there is one."""
        return next(
            (mine for block, mine in [*self.split(columns)][3:] if block.kind is VectorInW), None
        )

    def mirrored(self, columns: Columns, view: Turned, hand: Field) -> list[Field]:
        """Columns of `body` as they are seen from an equivalent side of the spacecraft."""
        blocks = list(self.split(columns))
        (flag,) = blocks[2][1]
        return [x for block, mine in blocks for x in block.mirrored(mine, view, hand, flag)]


class Observation(NamedTuple):
    """Observation of one instant as typed terms (paper, section 3.2)."""

    terms: tuple[ObservationTerm, ...]
    """Attitude, velocity, spin and task flag, then the task's data, filled up with zeros to the paper's."""

    def columns(self) -> tuple[Field, ...]:
        """The observation."""
        return tuple(x for term in self.terms for x in term.columns())

    def table(self) -> tuple[Column, ...]:
        """Name, unit and frame of each column."""
        return tuple(row for term in self.terms for row in term.table())

    def bounds(self) -> tuple[float, ...]:
        """Of each column's absolute value."""
        return tuple(term.bound for term in self.terms for _ in term.columns())

    def layout(self) -> Layout:
        """Which columns are what."""
        return Layout(tuple(term.block() for term in self.terms))


def to_body(attitude: Columns) -> Turned:
    """Function that turns vectors from W to B, from the columns of R_WB."""
    if len(attitude) == 2:
        c, s = attitude
        return lambda u: [c * u[0] + s * u[1], c * u[1] - s * u[0]]
    columns = list(zip(*matrix_rows(attitude), strict=True))
    return lambda u: [p * u[0] + q * u[1] + r * u[2] for p, q, r in columns]


def matrix_rows(matrix: Columns) -> list[Columns]:
    """The three rows of a rotation matrix, from the first two."""
    a = Vec3(*matrix[:3])
    b = Vec3(*matrix[3:])
    return [row.columns() for row in (a, b, a.cross(b))]
