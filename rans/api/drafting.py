"""A new spacecraft file, from numbers or from a spacecraft that comes with RANS."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rans.api.names import load_spacecraft
from rans.base.errors import ConfigError, RansWarning, brief
from rans.model.foreign import IMPORTERS, is_foreign
from rans.model.pace import misfits
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_draft import commented
from rans.model.spacecraft_file import USUAL, parse_spacecraft

if TYPE_CHECKING:
    from rans.model.authority import Authority

AUTHORITY_COLUMNS = ("axis", "forwards", "backwards", "acceleration")
"""Headings of `Draft.authority_rows`."""


@dataclass(frozen=True)
class Draft:
    """A spacecraft and the commented TOML text that describes it."""

    spacecraft: Spacecraft
    text: str

    @classmethod
    def of(cls, craft: Spacecraft, origin: Sequence[str]) -> Draft:
        """Draft whose text begins with these lines; it is read again, so that a draft is what its file will be."""
        text = commented(craft, origin)
        return cls(parse_spacecraft(text, craft.name), text)

    def __repr__(self) -> str:
        return f"<Draft of {self.spacecraft!r}>"

    def _repr_html_(self) -> str:
        from rans.base.table import Table
        from rans.show.pages.notebook import html_of

        title = f"{self.spacecraft.name}: largest force and torque"
        return html_of(Table(AUTHORITY_COLUMNS, self.authority_rows(), title))

    def authorities(self) -> tuple[Authority, ...]:
        """The largest force and torque along each axis, see `rans.model.authority.authorities`."""
        from rans.model.authority import authorities

        return authorities(self.spacecraft)

    def authority_rows(self) -> list[tuple[str, str, str, str]]:
        """Axis, largest force or torque each way, and the acceleration that the smaller one gives."""
        from rans.model.authority import authority_rows

        return authority_rows(self.authorities())

    def bearable(self) -> tuple[int, ...]:
        """Thrusters each of which may be dead while every force and torque stays possible."""
        from rans.randomization.faults import fault_sets

        if self.spacecraft.thruster_count < 2:
            return ()
        result = fault_sets(self.spacecraft, 1, "dead")
        return tuple(fault_set.thrusters[0] for fault_set in result if fault_set.recoverable)

    def write(
        self, file: str | Path, picture: str | Path | None = None, *, overwrite: bool = False
    ) -> None:
        """Write the file and, if asked for, a drawing of the thrusters (.svg, .png or .pdf).

        Raises:
            ConfigError: the file's name does not end in .toml, one of both exists and may not be overwritten,
                or the disk refused.
        """
        from rans.base.files import write_text

        check_target(Path(file), overwrite)
        if picture is not None:
            from rans.show.figures.picture_file import check_picture

            check_picture(Path(picture))
            check_free(Path(picture), overwrite)
        write_text(Path(file), self.text)
        if picture is not None:
            from rans.show.figures.layout_figure import draw_layout
            from rans.show.figures.picture_file import save_picture

            save_picture(draw_layout(self.spacecraft), Path(picture))


def init_spacecraft(
    name: str,
    *,
    base: str | Path | Spacecraft | None = None,
    dimension: int | None = None,
) -> Draft:
    """A new spacecraft that begins from another, with the commented TOML file in which to write its numbers.

    >>> draft = rans.init_spacecraft("mine", base="atmos")
    >>> draft.spacecraft, draft.bearable()
    (<Spacecraft mine: 17.8 kg in the plane, thrusters 8 x 1.5 N>, (0, 1, 2, 3, 4, 5, 6, 7))

    Args:
        name: name of the spacecraft.
        base: spacecraft (name, TOML file or object), or a file of other software: URDF (.urdf), of which the draft
            has what it says; None: the floating platform, in space the free flyer.
        dimension: 2: the plane, 3: space; None: that of the base, or the plane. A URDF does not say it.

    Raises:
        ConfigError: the base does not exist, is damaged or has another dimension, or a value is not physical.
    """
    if dimension is not None and dimension not in USUAL:
        raise ConfigError(f"dimension must be 2 (plane) or 3 (space), got {brief(dimension)}.")
    if base is not None and not isinstance(base, Spacecraft) and is_foreign(base):
        file = Path(base)
        if dimension is None:
            raise ConfigError(
                f"{file.name} does not say whether it moves in the plane or in space: choose --dimension 2 or 3."
            )
        read = IMPORTERS[file.suffix.lower()[1:]]
        craft, source, remarks = read(file, name, load_spacecraft(USUAL[dimension]))
    else:
        start = load_spacecraft(base or USUAL[dimension or 2])
        source = start.name
        remarks: tuple[str, ...] = ()
        if dimension not in (None, start.dimension):
            raise ConfigError(
                f"{start.name} has dimension {start.dimension}: another one needs other thrusters, so leave one of "
                "both out."
            )
        craft = replace(start, name=name)
    for doubt in (*remarks, *misfits(craft)):
        warnings.warn(f"of {source}: {doubt}.", RansWarning, stacklevel=2)
    origin = [f"Written by rans init, from {source}.", *(f"Of that file: {x}." for x in remarks)]
    return Draft.of(craft, origin)


def check_target(file: Path, overwrite: bool = False) -> None:
    """Refuse (`ConfigError`) what is no spacecraft file's name, or exists."""
    if file.suffix != ".toml":
        raise ConfigError(
            f"a spacecraft's file must end in .toml, as in {file.stem}.toml, got {str(file)!r}."
        )
    check_free(file, overwrite)


def check_free(file: Path, overwrite: bool = False) -> None:
    """Refuse (`ConfigError`) a file that exists, unless it may be overwritten."""
    if file.exists() and not overwrite:
        raise ConfigError(f"{file} exists: name another file, or delete it first.")
