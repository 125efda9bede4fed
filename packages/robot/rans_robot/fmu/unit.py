"""An agent as a unit of FMI 2.0 for co-simulation: description, library for Linux, and archive.

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
_SOURCES = ("unit.c", "agent_unit.c", "agent.c")
"""Files of C to compile."""
_HEADERS = ("unit.h", "agent.h")
_IDENTITY = "agent_fmu.h"
"""Header with the identity of the unit and its control period."""
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of every file in the archive, the earliest that there is: the same unit gives the same bytes."""


@dataclass(frozen=True)
class Variable:
    """A variable of a unit, whose reference is its number in the list."""

    name: str
    description: str
    causality: str
    """"input" or "output"."""
    unit: str = ""
    low: float | None = None
    high: float | None = None
    is_integer: bool = False


def write_unit(
    folder: Path,
    build: Path,
    name: str,
    title: str,
    period: float,
    variables: Sequence[Variable],
    contract: bytes,
) -> None:
    """Write agent.fmu into a folder.

    Args:
        folder: folder to write.
        build: folder that has agent.c and agent.h; sources of this package are added.
        name: name of the agent.
        title: one line about it.
        period: control period, s.
        variables: inputs and outputs, in the order of their references.
        contract: content of contract.json, which goes into the archive.

    Raises:
        ConfigError: the compiler refuses the sources, or the disk refuses.
    """
    for file in ("unit.c", "unit.h", "agent_unit.c"):
        text = (resources.files("rans_robot.fmu") / file).read_text("utf-8")
        (build / file).write_text(text, "utf-8")
    # Identity of sources and data, by which a simulator knows that library and description fit.
    content = hashlib.sha256(contract)
    for file in (*_SOURCES, *_HEADERS):
        content.update(read_bytes(build / file, _LARGEST))
    guid = f"{{{uuid.UUID(bytes=content.digest()[:16])}}}"
    (build / _IDENTITY).write_text(
        f'#define RANS_GUID "{guid}"\n#define RANS_PERIOD {float(period)!r}\n', "utf-8"
    )
    files = {"modelDescription.xml": _description(name, title, period, variables, guid)}
    for file in (*_SOURCES, *_HEADERS, _IDENTITY):
        files[f"sources/{file}"] = read_bytes(build / file, _LARGEST)
    files["resources/contract.json"] = contract
    if library := _compiled(build):
        files["binaries/linux64/agent.so"] = read_bytes(library, _LARGEST)
    replace_file(folder / "agent.fmu", lambda draft: _write_archive(draft, files))


def _description(
    name: str, title: str, period: float, listed: Sequence[Variable], guid: str
) -> bytes:
    """Content of modelDescription.xml; variables are numbered in the order of the list."""
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=name,
        guid=guid,
        description=title,
        generationTool=f"RANS {rans.__version__}",
        variableNamingConvention="flat",
        numberOfEventIndicators="0",
    )
    simulation = ElementTree.SubElement(
        root,
        "CoSimulation",
        modelIdentifier="agent",
        canHandleVariableCommunicationStepSize="true",
        canNotUseMemoryManagementFunctions="true",
    )
    sources = ElementTree.SubElement(simulation, "SourceFiles")
    for file in _SOURCES:
        ElementTree.SubElement(sources, "File", name=file)
    # Units stand before variables.
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(one.unit for one in listed if one.unit):
        ElementTree.SubElement(units, "Unit", name=unit)
    step = repr(float(period))
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=step)
    variables = ElementTree.SubElement(root, "ModelVariables")
    for number, one in enumerate(listed):
        _add_variable(variables, number, one)
    # Indices begin at 1.
    structure = ElementTree.SubElement(root, "ModelStructure")
    outputs = ElementTree.SubElement(structure, "Outputs")
    for index, one in enumerate(listed, 1):
        if one.causality == "output":
            ElementTree.SubElement(outputs, "Unknown", index=str(index))
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
        variability="discrete",
    )
    if one.causality != "input":
        entry.set("initial", "exact")
    kind = ElementTree.SubElement(entry, "Integer" if one.is_integer else "Real")
    if one.unit:
        kind.set("unit", one.unit)
    for key, value in (("min", one.low), ("max", one.high), ("start", 0.0)):
        if value is not None:
            kind.set(key, repr(int(value) if one.is_integer else float(value)))


def _compiled(build: Path) -> Path | None:
    """The library for Linux on x86-64; None on other machines, and without a compiler.

    Raises:
        ConfigError: the compiler refuses the sources.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None or (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        return None
    library = build / "agent.so"
    # A product and a sum are rounded one after the other, as the engine rounds them.
    options = ["-O2", "-ffp-contract=off", *FLAGS, "-shared", "-fPIC", "-fvisibility=hidden"]
    command = [compiler, *options, *(str(build / name) for name in _SOURCES)]
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
