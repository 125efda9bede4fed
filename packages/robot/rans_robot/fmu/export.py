"""``rans export --format fmu``: an agent as a functional mock-up unit of FMI 2.0 for co-simulation.

The agent's unit is the C export: its inputs are the columns of an observation, its outputs the commands. The format
is that of the FMI 2.0.4 specification, section 2.2 (modelDescription.xml), 2.3 (the archive) and 4.2
(co-simulation): description, library for Linux, and sources, which `unit.c` surrounds.
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
from rans.extend import FORMATS, ConfigError, Ports, Program, read_bytes, replace_file

_LARGEST = 2**28
"""Bytes of a file that goes into the archive; sources of agents have a hundredth of it."""
_SOURCES = ("unit.c", "agent_unit.c", "agent.c")
"""Files of C to compile."""
_HEADERS = ("unit.h", "agent.h")
_IDENTITY = "agent_fmu.h"
"""Header with the identity of the unit and its control period."""
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of every file in the archive, the earliest that there is: the same unit gives the same bytes."""


def write_fmu(
    folder: Path,
    program: Program,
    ports: Ports,
    title: str,
    contract: str,
    pairs: Mapping[str, Any] | None = None,
) -> None:
    """Write agent.fmu; see `rans.deploy.forms.ProgramWriter` for the arguments.

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
        FORMATS["c"].write(build, program, ports, title, contract, pairs)
        for file in ("unit.c", "unit.h", "agent_unit.c"):
            text = (resources.files("rans_robot.fmu") / file).read_text("utf-8")
            (build / file).write_text(text, "utf-8")
        # Identity of sources and data, by which a simulator knows that library and description fit.
        content = hashlib.sha256(contract.encode())
        for file in (*_SOURCES, *_HEADERS):
            content.update(read_bytes(build / file, _LARGEST))
        guid = f"{{{uuid.UUID(bytes=content.digest()[:16])}}}"
        period = float(about["control_period"])
        (build / _IDENTITY).write_text(
            f'#define RANS_GUID "{guid}"\n#define RANS_PERIOD {period!r}\n', "utf-8"
        )
        files = {"modelDescription.xml": _description(about, title, guid)}
        for file in (*_SOURCES, *_HEADERS, _IDENTITY):
            files[f"sources/{file}"] = read_bytes(build / file, _LARGEST)
        files["resources/contract.json"] = contract.encode()
        if library := _compiled(build):
            files["binaries/linux64/agent.so"] = read_bytes(library, _LARGEST)

    def archive(draft: Path) -> None:
        with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as opened:
            for name, content in files.items():
                opened.writestr(zipfile.ZipInfo(name, _EPOCH), content, zipfile.ZIP_DEFLATED)

    replace_file(folder / "agent.fmu", archive)


def _description(about: Mapping[str, Any], title: str, guid: str) -> bytes:
    """Content of modelDescription.xml, with the contract's units and meanings.

    Importers rely on names and order of the variables.
    """
    add = ElementTree.SubElement
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
    simulation = add(
        root,
        "CoSimulation",
        modelIdentifier="agent",
        canHandleVariableCommunicationStepSize="true",
        canNotUseMemoryManagementFunctions="true",
    )
    sources = add(simulation, "SourceFiles")
    for file in _SOURCES:
        add(sources, "File", name=file)
    # Units stand before variables.
    units = add(root, "UnitDefinitions")
    for unit in dict.fromkeys(str(column["unit"]) for column in about["observation"]):
        if unit:
            add(units, "Unit", name=unit)
    step = repr(float(about["control_period"]))
    add(root, "DefaultExperiment", startTime="0.0", stepSize=step)
    variables = add(root, "ModelVariables")
    outputs = add(add(root, "ModelStructure"), "Outputs")

    def variable(name: str, description: str, causality: str) -> ElementTree.Element:
        """A variable, whose reference is its place in the list."""
        number = len(variables)
        one = add(
            variables,
            "ScalarVariable",
            name=name,
            valueReference=str(number),
            description=description,
            causality=causality,
            variability="discrete",
        )
        if causality == "output":
            one.set("initial", "exact")
            add(outputs, "Unknown", index=str(number + 1))  # indices begin at 1
        return one

    for at, column in enumerate(about["observation"]):
        meaning = f"{column['name']}, frame {column['frame']}: {column['meaning']}"
        unit = {"unit": str(column["unit"])} if column["unit"] else {}
        add(variable(f"observation[{at}]", meaning, "input"), "Real", unit, start="0.0")
    for at, command in enumerate(about["command"]["ranges"]):
        limits = {"min": repr(float(command["low"])), "max": repr(float(command["high"]))}
        meaning = f"{command['name']}, {command['kind']}"
        add(variable(f"command[{at}]", meaning, "output"), "Real", limits, start="0.0")
    meaning = "sum of the flags RANS_HELD and others of agent.h; 0 where all is well"
    add(variable("notes", meaning, "output"), "Integer", start="0")
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)


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
    options = [
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-O2",
        "-ffp-contract=off",
        "-shared",
        "-fPIC",
        "-fvisibility=hidden",
    ]
    command = [compiler, *options, *(str(build / name) for name in _SOURCES)]
    done = subprocess.run(
        [*command, "-o", str(library), "-lm"], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise ConfigError(
            f"{compiler} refuses the sources of the FMU: {(done.stderr.splitlines() or [''])[0]}."
        )
    return library
