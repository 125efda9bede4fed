"""``rans export --format fmu``: an agent as a functional mock-up unit of FMI 2.0 for co-simulation.

The unit is the C export with `fmu.c` around it: its inputs are the columns of an observation, its outputs the
commands. It has the sources, and on Linux with a C compiler the library for it. The format is that of the FMI 2.0.4
specification, section 2.2 (modelDescription.xml), 2.3 (the archive) and 4.2 (co-simulation).
"""

from __future__ import annotations

import hashlib
import json
import platform
import shutil
import subprocess
import tempfile
import uuid
import zipfile
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import rans
from rans.deploy.c.compiler import FLAGS
from rans.deploy.c.files import write_c
from rans.deploy.program import Ports
from rans.extend import ConfigError, Program, read_bytes
from rans.files import replace_file

_SOURCES = ("fmu.c", "agent.c")
_HEADERS = ("agent.h", "fmu_agent.h")
_LARGEST = 2**28
"""Bytes of a file that goes into the archive; sources of agents have a hundredth of it."""
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of every file in the archive, the earliest that there is: the same agent gives the same bytes."""


def write_fmu(
    folder: Path,
    program: Program,
    ports: Ports,
    title: str,
    contract: str,
    pairs: Mapping[str, Any] | None = None,
) -> None:
    """Write agent.fmu; see `rans.deploy.c.files.write_c` for the arguments.

    Raises:
        ConfigError: the agent has no contract, the program has an operation that is not known in C, the compiler
            refuses the sources, or the disk refuses.
    """
    if not contract:
        raise ConfigError(
            "an FMU states control period, inputs and outputs, which need a contract."
        )
    about = json.loads(contract)
    with tempfile.TemporaryDirectory() as name:
        build = Path(name)
        write_c(build, program, ports, title, contract, pairs)
        (build / "fmu.c").write_text(_own_source(), "utf-8")
        guid = _guid(build, contract)
        (build / "fmu_agent.h").write_text(
            f'#define RANS_GUID "{guid}"\n#define RANS_PERIOD {float(about["control_period"])!r}\n',
            "utf-8",
        )
        files = {"modelDescription.xml": _description(about, title, guid, ports)}
        files |= {
            f"sources/{one}": read_bytes(build / one, _LARGEST) for one in (*_SOURCES, *_HEADERS)
        }
        files["resources/contract.json"] = contract.encode()
        if library := _compiled(build):
            files["binaries/linux64/agent.so"] = read_bytes(library, _LARGEST)
        replace_file(folder / "agent.fmu", lambda draft: _write_archive(draft, files))


def _own_source() -> str:
    """The C file around every agent, which is data of this package."""
    return (resources.files("rans_robot.fmu") / "fmu.c").read_text("utf-8")


def _guid(build: Path, contract: str) -> str:
    """Identity of the agent's sources and contract, by which a simulator knows that library and description fit."""
    content = hashlib.sha256(contract.encode())
    for name in ("agent.c", "fmu.c"):
        content.update(read_bytes(build / name, _LARGEST))
    return f"{{{uuid.UUID(bytes=content.digest()[:16])}}}"


def _description(about: Mapping[str, Any], title: str, guid: str, ports: Ports) -> bytes:
    """modelDescription.xml: inputs, outputs and notes, with units and meanings of the contract."""
    period = repr(float(about["control_period"]))
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=str(about["agent"]),
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
    for name in _SOURCES:
        ElementTree.SubElement(sources, "File", name=name)
    # Units stand before variables.
    columns = about["observation"]
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(str(column["unit"]) for column in columns):
        ElementTree.SubElement(units, "Unit", name=unit)
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=period)
    variables = ElementTree.SubElement(root, "ModelVariables")
    for at, column in enumerate(columns):
        variable = _variable(variables, f"observation[{at}]", at, "input")
        variable.set(
            "description", f"{column['name']}, frame {column['frame']}: {column['meaning']}"
        )
        ElementTree.SubElement(variable, "Real", unit=str(column["unit"]), start="0.0")
    for at, command in enumerate(about["command"]["ranges"]):
        number = ports.observation + at
        variable = _variable(variables, f"command[{at}]", number, "output")
        variable.set("description", f"{command['name']}, {command['kind']}")
        variable.set("initial", "exact")
        low, high = repr(float(command["low"])), repr(float(command["high"]))
        ElementTree.SubElement(variable, "Real", min=low, max=high, start="0.0")
    notes = _variable(variables, "notes", ports.observation + ports.command, "output")
    notes.set(
        "description", "sum of the flags RANS_HELD and others of agent.h; 0 where all is well"
    )
    notes.set("initial", "exact")
    ElementTree.SubElement(notes, "Integer", start="0")
    outputs = ElementTree.SubElement(ElementTree.SubElement(root, "ModelStructure"), "Outputs")
    for at in range(ports.command + 1):
        ElementTree.SubElement(outputs, "Unknown", index=str(ports.observation + at + 1))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)


def _variable(
    variables: ElementTree.Element, name: str, number: int, causality: str
) -> ElementTree.Element:
    return ElementTree.SubElement(
        variables,
        "ScalarVariable",
        name=name,
        valueReference=str(number),
        causality=causality,
        variability="discrete",
    )


def _compiled(build: Path) -> Path | None:
    """The library for Linux on x86-64; None on other machines, and without a compiler.

    Raises:
        ConfigError: the compiler refuses the sources.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None or (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        return None
    library = build / "agent.so"
    sources = [str(build / name) for name in _SOURCES]
    command = [compiler, "-O2", *FLAGS, "-shared", "-fPIC", "-fvisibility=hidden", *sources]
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
