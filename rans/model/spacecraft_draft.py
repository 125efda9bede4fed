"""Commented spacecraft files from a few numbers, as `rans init` writes them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from rans.base.languages import Toml
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import sections

_MEANINGS = {
    "": {
        "dimension": "2: x, y and heading; 3: position and attitude",
        "mass": "kg; source:",
        "inertia": "kg m^2 about the centre of mass, axes of G; source:",
        "centre_of_mass": "m, in G; source:",
        "thrust_sharing": '"none": every open thruster gives its full force; "split": they share that of one',
        "radius": "m, for drawings",
        "shape": "for drawings",
    },
    "[actuators]": {
        "counts": "steps into which valves divide a control period; source:",
        "least": "shortest pulse of valves, counts, or least level of throttles, a share of full force; source:",
        "most": "largest level, a share of full force; source:",
        "always_lit": "whether engines cannot be shut; source:",
    },
    "[propellant]": {
        "mass": "kg in a full tank, part of the craft's mass; source:",
        "specific_impulse": "s; source:",
        "position": "m, of the tank in G",
        "radius": "m, of the tank",
    },
    "[[thruster]]": {
        "position": "m, in G",
        "direction": "of the force, opposite to the exhaust",
        "force": "N, when open; source:",
        "supply": "which feeds it",
    },
    "[[wheel]]": {
        "axis": "in G",
        "max_torque": "N m, of the motor; source:",
        "max_momentum": "N m s, about the axis; source:",
        "inertia": "kg m^2, about the axis; source:",
    },
}
"""Unit and meaning of the keys of a file by its tables, with a place for the source of a number."""


def commented(craft: Spacecraft, origin: Sequence[str]) -> str:
    """TOML text of a spacecraft with the unit and meaning of every number and a place for its source.

    Args:
        craft: spacecraft; `rans.model.spacecraft_file.parse_spacecraft` reads it back.
        origin: lines that say how the file was made.
    """
    lines = [
        *(f"# {Toml.word(line)}" for line in origin),
        "# G is any frame fixed to the body. Write the source of every number beside it, or that it is",
        "# estimated.",
    ]
    numbers: Counter[str] = Counter()
    for title, table in sections(craft, every=True):
        heading = title.strip()
        if heading:
            number = f"  # {numbers[heading]}" if heading.startswith("[[") else ""
            lines.extend(["", f"{heading}{number}"])
            numbers[heading] += 1
        elif craft.dimension == 2:
            table["inertia"] = craft.inertia[2][2]
        for key, value in table.items():
            meaning = _MEANINGS.get(heading, {}).get(key)
            lines.append(f"{key} = {Toml.value(value)}{f'  # {meaning}' if meaning else ''}")
    return "\n".join(lines) + "\n"
