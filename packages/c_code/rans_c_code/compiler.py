"""The machine's C compiler on an exported agent: its golden pairs, its size and the stack that it needs."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

from rans.extend import ConfigError, read_text, reading, write_json

FLAGS = (
    *("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"),
    *("-Wfloat-equal", "-Wshadow", "-Wdouble-promotion", "-Wcast-align", "-Wlogical-op"),
    "-Wno-unknown-warning-option",  # clang lacks -Wlogical-op
)
"""The files compile without a warning with these; those of the second line are PX4's, of firmware for flight."""


def compiled_check(folder: Path) -> str:
    """Sentence on what the compiler here finds, which contract.json then has too, for dossiers.

    Raises:
        ConfigError: as `_found`, or the folder has no contract.
    """
    found = _found(folder)
    with reading(folder / "contract.json") as contract:
        about = contract.get("c", {})
        if "stack" in about:
            found = f"{found} It needs {about['stack']:,} bytes of stack."
        contract["c"] = about | {"checked": found}
    write_json(folder / "contract.json", contract)
    return f"{found} Add agent.c to your firmware, and call it as the first lines of agent.h do."


def _found(folder: Path) -> str:
    """Sentence on what agent_check.c finds, compiled by the machine's compiler, and on the size of the agent.

    It is compiled twice: as C99 asks, and as for finite numbers alone, as much firmware is.

    Raises:
        ConfigError: the compiler refuses the files, some golden pairs come out wrong, or numbers that are not
            finite are flown.
    """
    compiler = _compiler()
    if compiler is None:
        command = f"cc -O2 {' '.join(FLAGS)} agent.c agent_check.c -lm"
        return f"There is no C compiler here: check it on yours by {command}."
    results = []
    size = 0
    with tempfile.TemporaryDirectory() as build_folder:
        for optimization in (("-O2", "-ffast-math"), ("-O2",)):
            # The agent alone, whose object code has its size, and with the program that checks it.
            compiled = [compiler, *optimization, *FLAGS]
            part = Path(build_folder) / "agent.o"
            built = Path(build_folder) / "check"
            for arguments in (
                [*compiled, "-c", str(folder / "agent.c"), "-o", str(part)],
                [*compiled, str(folder / "agent_check.c"), str(part), "-o", str(built), "-lm"],
            ):
                done = subprocess.run(arguments, capture_output=True, text=True, check=False)
                if done.returncode:
                    raise ConfigError(
                        f"{compiler} refuses agent.c: {(done.stderr.splitlines() or [''])[0]}."
                    )
            size = loaded_size(part)
            run = subprocess.run([str(built)], capture_output=True, text=True, check=False)
            if run.returncode:
                flags = " ".join(optimization)
                raise ConfigError(f"agent.c is wrong: {run.stdout.strip()} (built by {flags})")
            results.append(run.stdout.strip())
    return f"agent.c is {size / 1000:.0f} kB of code and tables here; {results[-1]}"


def loaded_size(part: Path) -> int:
    """Bytes of code and tables in an object file, by the program size; else of the file, which has names too."""
    tool = shutil.which("size")
    if tool is None:
        return part.stat().st_size
    done = subprocess.run([tool, str(part)], capture_output=True, text=True, check=False)
    # A line of titles and one of numbers, of which dec is the sum; macOS has other parts than binutils.
    titles, numbers = (line.split() for line in [*done.stdout.splitlines(), "", ""][:2])
    sums = dict(zip(titles, numbers, strict=False))
    return int(sums["dec"]) if done.returncode == 0 and "dec" in sums else part.stat().st_size


def _compiler() -> str | None:
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def measured_stack(folder: Path) -> int | None:
    """Bytes of stack of `rans_agent_act` with what it calls, by the compiler; None if none here can say.

    The frame of that function and the largest of those that it calls, which call no other one.
    """
    compiler = _compiler()
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory() as build_folder:
        part = Path(build_folder) / "agent.o"
        arguments = [compiler, "-O2", "-std=c99", "-fstack-usage", "-c", str(folder / "agent.c")]
        subprocess.run([*arguments, "-o", str(part)], capture_output=True, check=False)
        usage = part.with_suffix(".su")
        if not usage.exists():
            return None
        # A line a function: FILE:LINE:COLUMN:NAME, bytes and kind, with tabs between.
        rows = [line.split("\t") for line in read_text(usage).splitlines()]
    frames = {row[0].rpartition(":")[2]: int(row[1]) for row in rows}
    own = next(frames.pop(name) for name in [*frames] if name.endswith("_act"))
    return own + max(frames.values())  # nothing that it calls calls another function of the file
