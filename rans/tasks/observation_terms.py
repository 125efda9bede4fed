"""Observations as typed terms, whose types determine width, names, frames, mirror images and targets.

The observation of the paper (section 3.2) is one layout: attitude, velocity, spin, task flag, then four columns
of task data in the plane and nine in space. Tasks may have more columns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal, NamedTuple

from rans.base.errors import ConfigError
from rans.model.fields import Attitude, Field, Vec3, Vector, where

Dimension = Literal[2, 3]
Columns = Sequence[Field]
Turned = Callable[[Columns], Columns]
"""Function from two or three columns of a vector to its columns in other coordinates."""


class Column(NamedTuple):
    """Name, unit and frame of one column of an observation."""

    name: str
    unit: str
    frame: str


@dataclass(frozen=True)
class ObservationTerm:
    """One term of an observation; its class defines how its columns transform to B and under mirror images."""

    name: str
    """First part of the names of its columns."""
    unit: str
    value: Field | tuple[Field, ...] | Vector | Attitude
    meaning: str = field(default="", kw_only=True)
    """What its columns are, for the contract of exported agents: reference point, and sign of a difference. Not
    needed for own motion, and differences of position, attitude and velocity between goal and spacecraft, which
    `rans.deploy.columns` recognizes by their values."""

    frame: ClassVar[str] = "-"
    bound: ClassVar[float] = float("inf")
    """Largest absolute value of its columns."""

    def columns(self) -> Columns:
        """Columns of the term, in order."""
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
        """Values of the columns at the goal of the task; by default zero."""
        return (0.0,) * len(self.columns())

    def block(self) -> Block:
        """Class and width of the term, without its values."""
        return Block(type(self), len(self.columns()))

    @staticmethod
    def in_body(columns: Columns, turned: Turned) -> Columns:
        """The columns expressed in B, where ``turned`` rotates vectors from W to B."""
        return columns

    @staticmethod
    def mirrored(columns: Columns, view: Turned, hand: Field) -> Columns:
        """The columns in B under a symmetry ``view`` of the spacecraft; ``hand`` is -1 for a mirror image."""
        return columns


@dataclass(frozen=True)
class VectorInW(ObservationTerm):
    """A vector expressed in W; policies receive it in B."""

    value: Vector
    frame = "W"

    def labels(self) -> Sequence[str]:
        """Name of each column, which ends in its axis."""
        return [self.name + axis for axis in "xyz"[: len(self.columns())]]

    @staticmethod
    def in_body(columns: Columns, turned: Turned) -> Columns:
        """The vector expressed in B."""
        return turned(columns)

    @staticmethod
    def mirrored(columns: Columns, view: Turned, hand: Field) -> Columns:
        """The vector under a symmetry of the spacecraft."""
        return view(columns)


@dataclass(frozen=True)
class AngularVelocity(ObservationTerm):
    """An angular velocity in B, which a mirror image reverses."""

    value: tuple[Field, ...]
    frame = "B"

    def labels(self) -> Sequence[str]:
        """Name of each column, which ends in its axis."""
        return [f"{self.name}_{axis}" for axis in ("z" if len(self.value) == 1 else "xyz")]

    @staticmethod
    def mirrored(columns: Columns, view: Turned, hand: Field) -> Columns:
        """The angular velocity under a symmetry of the spacecraft."""
        return [x * hand for x in (columns if len(columns) == 1 else view(columns))]


@dataclass(frozen=True)
class RelativeRotation(ObservationTerm):
    """A rotation relative to B, R_B^T R, such as that from the attitude to the goal's attitude."""

    value: Attitude
    bound = 1.0
    matrix: ClassVar[str] = "R"
    """Symbol of the rotation matrix in names of columns."""

    def labels(self) -> Sequence[str]:
        """Name of each column: cosine and sine, or entries of the first two rows of the matrix."""
        if len(self.columns()) == 2:
            return [f"cos {self.name}heading", f"sin {self.name}heading"]
        return [f"{self.name}{self.matrix}[{i},{j}]" for i in (0, 1) for j in (0, 1, 2)]

    def table(self) -> Iterator[Column]:
        """Name, unit and frame of each column; an angle has no frame, and the rows of R_B^T R are in B."""
        frame = "B" if type(self) is RelativeRotation and len(self.columns()) > 2 else self.frame
        return (row._replace(frame=frame) for row in super().table())

    def target(self) -> Sequence[float]:
        """Columns of the identity rotation."""
        return (1.0, 0.0) if len(self.columns()) == 2 else (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)

    @staticmethod
    def mirrored(columns: Columns, view: Turned, hand: Field) -> Columns:
        """First two rows of G R G^T, for the symmetry G and the first two rows of R."""
        if len(columns) == 2:
            return [columns[0], columns[1] * hand]
        views = [view(column) for column in zip(*matrix_rows(columns), strict=True)]
        return [x for row in list(zip(*views, strict=True))[:2] for x in view(row)]


@dataclass(frozen=True)
class OwnRotation(RelativeRotation):
    """Attitude R_WB of the craft, which turns vectors to B and is then removed (docs/decisions/learning.md)."""

    frame = "W"
    matrix = "R_WB"

    @staticmethod
    def in_body(columns: Columns, turned: Turned) -> Columns:
        """No columns: the attitude is removed."""
        return ()


@dataclass(frozen=True)
class Scalar(ObservationTerm):
    """A number that is invariant under changes of frame and mirror images."""


@dataclass(frozen=True)
class TradeOff(Scalar):
    """A trade-off between objectives, 0 to 1, which is constant over an episode."""

    bound = 1.0

    def target(self) -> Columns:
        """The trade-off itself."""
        return self.columns()


@dataclass(frozen=True)
class Information(Scalar):
    """A number without a target value that a policy should know, such as a margin."""

    def target(self) -> Columns:
        """The number itself: controllers do not drive it."""
        return self.columns()


@dataclass(frozen=True)
class InformationInW(VectorInW):
    """A vector in W without a target value that a policy should know, such as that to a zone."""

    def target(self) -> Columns:
        """The vector itself: controllers do not drive it."""
        return self.columns()


@dataclass(frozen=True)
class TaskDependent(ObservationTerm):
    """Columns whose classes depend on the task flag: those of the task that an episode draws."""

    value: tuple[Field, ...]
    choices: tuple[Choice, ...] = ()

    def labels(self) -> Sequence[str]:
        """Name of each column, which ends in its number."""
        return [f"{self.name} {i}" for i in range(len(self.value))]

    def target(self) -> Sequence[float]:
        """Not available, because the tasks have different targets.

        Raises:
            ConfigError: always.
        """
        raise ConfigError(
            "a multi-task's data have no target that its tasks share: name one of them."
        )

    def block(self) -> Block:
        """Class and width of the term, with the blocks under each task flag."""
        return Block(TaskDependent, len(self.value), self.choices)


class Block(NamedTuple):
    """Class and number of the columns of one term, without their values; `TaskDependent` has choices."""

    kind: type[ObservationTerm]
    width: int
    choices: tuple[Choice, ...] = ()

    def mirrored(self, columns: Columns, view: Turned, hand: Field, flag: Field) -> Columns:
        """Columns (fields) in B under a symmetry of the spacecraft, for a task flag.

        ``view`` turns vectors of B, and ``hand`` is -1 for a mirror image, which reverses angular velocities.
        """
        result = self.kind.mirrored(columns, view, hand)
        for choice, blocks in self.choices:
            images = [
                x
                for block, mine in Layout(blocks).split(columns)
                for x in block.mirrored(mine, view, hand, flag)
            ]
            result = [where(flag == choice, a, b) for a, b in zip(images, result, strict=True)]
        return result


Choice = tuple[float, tuple[Block, ...]]
"""A task flag, and the blocks of the columns under it."""


class Layout(NamedTuple):
    """Blocks of an observation: attitude, velocity, spin, task flag and task data; saved with every policy."""

    blocks: tuple[Block, ...]

    @property
    def width(self) -> int:
        """Number of columns."""
        return sum(block.width for block in self.blocks)

    @property
    def body(self) -> Layout:
        """Layout of the result of `in_body`."""
        return Layout(tuple(block for block in self.blocks if block.kind is not OwnRotation))

    def split(self, columns: Columns) -> Iterator[tuple[Block, Columns]]:
        """Each block with its columns."""
        start = 0
        for block in self.blocks:
            yield block, columns[start : start + block.width]
            start += block.width

    def in_body(self, columns: Columns) -> list[Field]:
        """Columns of an observation with vectors in B and without the attitude, in the layout `body`."""
        columns_in_body = to_body(columns[: self.blocks[0].width])
        return [
            x
            for block, mine in self.split(columns)
            for x in block.kind.in_body(mine, columns_in_body)
        ]

    def ahead(self, columns: Columns) -> Columns | None:
        """First vector of the task data, such as that to the goal, from columns in the layout `body`; else None."""
        return next(
            (mine for block, mine in [*self.split(columns)][3:] if block.kind is VectorInW), None
        )

    def mirrored(self, columns: Columns, view: Turned, hand: Field) -> list[Field]:
        """Columns in the layout `body` under a symmetry of the spacecraft."""
        blocks = list(self.split(columns))
        (flag,) = blocks[2][1]
        return [x for block, mine in blocks for x in block.mirrored(mine, view, hand, flag)]


class Observation(NamedTuple):
    """Observation of one instant as typed terms (paper, section 3.2)."""

    terms: tuple[ObservationTerm, ...]
    """Attitude, velocity, spin, task flag and task data, padded with zeros to the width of the paper."""

    def columns(self) -> tuple[Field, ...]:
        """Columns of the observation."""
        return tuple(x for term in self.terms for x in term.columns())

    def table(self) -> tuple[Column, ...]:
        """Name, unit and frame of each column."""
        return tuple(row for term in self.terms for row in term.table())

    def bounds(self) -> tuple[float, ...]:
        """Upper bound on the absolute value of each column."""
        return tuple(term.bound for term in self.terms for _ in term.columns())

    def layout(self) -> Layout:
        """Layout of the columns."""
        return Layout(tuple(term.block() for term in self.terms))


def to_body(attitude: Columns) -> Turned:
    """Function that rotates vectors from W to B, from the columns of R_WB."""
    if len(attitude) == 2:
        c, s = attitude
        return lambda u: [c * u[0] + s * u[1], c * u[1] - s * u[0]]
    columns = list(zip(*matrix_rows(attitude), strict=True))
    return lambda u: [p * u[0] + q * u[1] + r * u[2] for p, q, r in columns]


def matrix_rows(matrix: Columns) -> list[Columns]:
    """Three rows of a rotation matrix, from the first two."""
    a = Vec3(*matrix[:3])
    b = Vec3(*matrix[3:])
    return [row.columns() for row in (a, b, a.cross(b))]
