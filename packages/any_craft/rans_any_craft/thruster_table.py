"""Thrusters of a spreadsheet, saved as CSV: a line for each, with units in the header."""

from __future__ import annotations

import math
import re
from pathlib import Path

from rans.base.csv_file import read_csv
from rans.extend import ConfigError, Spacecraft, brief
from rans_any_craft.foreign import Foreign, Nozzle

_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_UNITS: dict[str, dict[str, float]] = {
    **{key: _LENGTHS for key in ("x", "y", "z")},
    **{key: {"": 1.0} for key in ("dx", "dy", "dz")},
    "angle": {"deg": math.pi / 180.0, "degrees": math.pi / 180.0, "rad": 1.0},
    "force": {"n": 1.0, "mn": 1e-3},
}
"""Columns, each with what a number in a unit is in SI units."""
_HEADER = "x (cm), y (cm), angle (deg), force (N), in space x, y, z, dx, dy, dz and force"


def of_table(file: Path, name: str, usual: Spacecraft) -> tuple[Spacecraft, str, tuple[str, ...]]:
    """See `rans.model.foreign.Importer`; mass and inertia are those of the usual craft.

    Raises:
        ConfigError: a column is missing, is there twice or has no unit, or a cell is no number.
    """
    table = read_csv(file, what="the spacecraft file ")
    places: dict[str, tuple[int, float]] = {}
    for place, cell in enumerate(table.header):
        word, unit = re.fullmatch(r"\W*(\w*?)[\W_]*([a-z]*)\W*", cell.lower()).groups()  # type: ignore[union-attr]
        column, unit = (word, unit) if word in _UNITS else (unit, "")
        if column not in _UNITS:
            continue
        if column in places or unit not in _UNITS[column]:
            raise ConfigError(
                f"{file}: the column {brief(cell)} must be there once, with its unit, "
                f"{' or '.join(_UNITS[column])}, as in {_HEADER}."
            )
        places[column] = place, _UNITS[column][unit]
    spatial = usual.dimension == 3
    ways = ("dx", "dy", "dz") if spatial else ("dx", "dy")
    ways = ("angle",) if not spatial and "angle" in places else ways
    needed = (*("xyz" if spatial else "xy"), *ways, "force")
    if missing := [one for one in needed if one not in places]:
        raise ConfigError(f"{file} has no column {', '.join(missing)}: write {_HEADER}.")
    nozzles = []
    for line, row in table.rows:
        x = {one: places[one][1] * table.number(line, one, row[places[one][0]]) for one in needed}
        along = (
            [math.cos(x["angle"]), math.sin(x["angle"])] if "angle" in x else [x[k] for k in ways]
        )
        size = math.hypot(*along)
        if not size > 0.0:
            raise ConfigError(f"{table.what}, line {line}: the direction has no length.")
        along_x, along_y, along_z = *(one / size for one in along), *[0.0] * (3 - len(along))
        at = x["x"], x["y"], x.get("z", 0.0)
        nozzles.append(Nozzle(f"line {line}", at, (along_x, along_y, along_z), x["force"]))
    remark = f"it has thrusters alone, and mass and centre of mass here are those of {usual.name}"
    found = Foreign(
        f"{file.name}, a table of thrusters",
        usual.mass,
        None,
        usual.centre_of_mass,
        tuple(nozzles),
        (remark,),
    )
    craft, remarks = found.spacecraft(name, usual)
    return craft, found.source, remarks
