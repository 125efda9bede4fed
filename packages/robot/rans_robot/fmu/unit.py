"""Units of FMI 2.0 for co-simulation: description, library for Linux, and archive.

The format is that of the FMI 2.0.4 specification, section 2.2 (modelDescription.xml), 2.3 (the archive) and 4.2
(co-simulation). What a unit does is in its sources, which `unit.c` surrounds.
"""

from __future__ import annotations

import hashlib
import platform
import shutil
import subprocess
import uuid
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree

import rans
from rans.deploy.c.compiler import FLAGS
from rans.extend import ConfigError, read_bytes
from rans.files import replace_file

_LARGEST = 2**28
"""Bytes of a file that goes into the archive; sources of agents have a hundredth of it."""
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of every file in the archive, the earliest that there is: the same unit gives the same bytes."""


@dataclass(frozen=True)
class Variable:
    """A variable of a unit, whose reference is its number in the list."""

    name: str
    description: str
    causality: str
    """"input", "parameter" or "output"."""
    unit: str = ""
    variability: str = "discrete"
    start: float | None = None
    """None: the unit computes the value at the start from others."""
    low: float | None = None
    high: float | None = None
    is_integer: bool = False


@dataclass(frozen=True)
class Unit:
    """A unit of FMI 2.0 for co-simulation."""

    identifier: str
    """Name of the file, of the library and of the model: "agent" or "craft"."""
    name: str
    title: str
    period: float
    """Control period, s."""
    any_step: bool
    """Whether steps may have any length, and not only whole control periods."""
    variables: Sequence[Variable]
    sources: Sequence[str]
    """Files of C to compile, beside unit.c."""
    headers: Sequence[str]
    """Further files that these include, beside unit.h."""

    @property
    def own_header(self) -> str:
        """Header that has the identity."""
        return f"{self.identifier}_fmu.h"


def write_unit(folder: Path, build: Path, unit: Unit, further: Mapping[str, bytes]) -> None:
    """Write IDENTIFIER.fmu into a folder.

    Args:
        folder: folder to write.
        build: folder that has the sources and headers but those of this package, which are added.
        unit: what it is.
        further: other files of the archive by their names.

    Raises:
        ConfigError: the compiler refuses the sources, or the disk refuses.
    """
    own = [name for name in ("unit.c", "unit.h", f"{unit.identifier}_unit.c")]
    for name in own:
        text = (resources.files("rans_robot.fmu") / name).read_text("utf-8")
        (build / name).write_text(text, "utf-8")
    sources = ("unit.c", *unit.sources)
    names = (*sources, "unit.h", *unit.headers)
    # Identity of sources and data, by which a simulator knows that library and description fit.
    content = hashlib.sha256(b"".join(further.values()))
    for name in names:
        content.update(read_bytes(build / name, _LARGEST))
    guid = f"{{{uuid.UUID(bytes=content.digest()[:16])}}}"
    (build / unit.own_header).write_text(
        f'#define RANS_GUID "{guid}"\n#define RANS_PERIOD {float(unit.period)!r}\n', "utf-8"
    )
    files = {"modelDescription.xml": _description(unit, guid, sources)}
    files |= {
        f"sources/{name}": read_bytes(build / name, _LARGEST) for name in (*names, unit.own_header)
    }
    files |= further
    if library := _compiled(build, unit.identifier, sources):
        files[f"binaries/linux64/{unit.identifier}.so"] = read_bytes(library, _LARGEST)
    replace_file(folder / f"{unit.identifier}.fmu", lambda draft: _write_archive(draft, files))


def _description(unit: Unit, guid: str, sources: Sequence[str]) -> bytes:
    """Content of modelDescription.xml; variables are numbered in the order of the unit's list."""
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=unit.name,
        guid=guid,
        description=unit.title,
        generationTool=f"RANS {rans.__version__}",
        variableNamingConvention="flat",
        numberOfEventIndicators="0",
    )
    simulation = ElementTree.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=unit.identifier,
        canHandleVariableCommunicationStepSize=str(unit.any_step).lower(),
        canNotUseMemoryManagementFunctions="true",
    )
    listed = ElementTree.SubElement(simulation, "SourceFiles")
    for name in sources:
        ElementTree.SubElement(listed, "File", name=name)
    # Units stand before variables.
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(one.unit for one in unit.variables if one.unit):
        ElementTree.SubElement(units, "Unit", name=name)
    period = repr(float(unit.period))
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=period)
    variables = ElementTree.SubElement(root, "ModelVariables")
    for number, one in enumerate(unit.variables):
        _add_variable(variables, number, one)
    # Outputs, and those of them whose first value is computed; indices begin at 1.
    structure = ElementTree.SubElement(root, "ModelStructure")
    outputs = ElementTree.SubElement(structure, "Outputs")
    computed = []
    for index, one in enumerate(unit.variables, 1):
        if one.causality == "output":
            ElementTree.SubElement(outputs, "Unknown", index=str(index))
            if one.start is None:
                computed.append(index)
    if computed:
        initial = ElementTree.SubElement(structure, "InitialUnknowns")
        for index in computed:
            ElementTree.SubElement(initial, "Unknown", index=str(index))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)


def _add_variable(variables: ElementTree.Element, number: int, one: Variable) -> None:
    """Add a variable with its type, unit, range and start; its number is its place in the list."""
    entry = ElementTree.SubElement(
        variables,
        "ScalarVariable",
        name=one.name,
        valueReference=str(number),
        description=one.description,
        causality=one.causality,
        variability=one.variability,
    )
    if one.causality != "input":
        entry.set("initial", "calculated" if one.start is None else "exact")
    kind = ElementTree.SubElement(entry, "Integer" if one.is_integer else "Real")
    if one.unit:
        kind.set("unit", one.unit)
    for key, value in (("min", one.low), ("max", one.high), ("start", one.start)):
        if value is not None:
            kind.set(key, repr(int(value) if one.is_integer else float(value)))


def _compiled(build: Path, identifier: str, sources: Sequence[str]) -> Path | None:
    """The library for Linux on x86-64; None on other machines, and without a compiler.

    Raises:
        ConfigError: the compiler refuses the sources.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None or (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        return None
    library = build / f"{identifier}.so"
    # A product and a sum are rounded one after the other, as the engine rounds them.
    options = ["-O2", "-ffp-contract=off", *FLAGS, "-shared", "-fPIC", "-fvisibility=hidden"]
    command = [compiler, *options, *(str(build / name) for name in sources)]
    done = subprocess.run(
        [*command, "-o", str(library), "-lm"], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise ConfigError(
            f"{compiler} refuses the sources of the FMU: {(done.stderr.splitlines() or [''])[0]}."
        )
    return library


def _write_archive(draft: Path, files: Mapping[str, bytes]) -> None:
    """A zip file with these files."""
    with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, _EPOCH), content, zipfile.ZIP_DEFLATED)
