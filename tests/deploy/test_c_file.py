"""agent.c: what it needs, what it does with wild readings, and names of strangers in it."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from rans.cli import main
from rans.deploy.c_file import C_FILES, FLAGS, compiled_check, write_c
from rans.deploy.contract import contract, golden
from rans.deploy.program import agent_program
from rans.errors import ConfigError
from rans.fast.learn.run_folder import RunFolder
from rans.files import plain
from rans.pretrained import pretrained_folder
from tests.support.exports import FAST, exported, remembering, written
from validation.records.exports import c_compilers

if shutil.which("cc") is None:
    pytest.skip("needs a C compiler", allow_module_level=True)

HELD, SHUT, FORGOTTEN, UNTRIED = 1, 2, 4, 8


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An agent with a memory, as C and as NumPy, with its contract."""
    path = tmp_path_factory.mktemp("agent")
    network, _, seen = remembering()
    run = RunFolder(pretrained_folder("go-to-pose-2d-faults"))
    craft = run.spacecraft()
    memory = network.architecture.memory
    about = plain(contract("me", run.config(), craft, "", memory, seen))
    written(path, network, "numpy")
    (path / "contract.json").write_text(json.dumps(about))
    pairs = golden(network, seen, craft)
    (path / "golden.json").write_text(json.dumps(pairs))
    program = agent_program(network, craft)
    write_c(path, program, network.architecture, "it", json.dumps(about), pairs)
    return path


def library(folder: Path) -> ctypes.CDLL:
    built = folder / "agent.so"
    command = ["cc", "-O2", *FLAGS, "-shared", "-fPIC", str(folder / "agent.c"), "-o", str(built)]
    subprocess.run([*command, "-lm"], check=True)
    return ctypes.CDLL(str(built))


def pointer(values: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


def test_golden_pairs_come_out_of_c(folder: Path) -> None:
    assert "500 of 500 golden pairs come out as they should" in compiled_check(folder)


def test_golden_pairs_come_out_of_clang(folder: Path, tmp_path: Path) -> None:
    """Its warnings are others than those of gcc, and errors too."""
    clang = c_compilers().get("clang")
    if clang is None:
        pytest.skip("no clang on the PATH, and no ziglang to import, whose `zig cc` is clang")
    built = tmp_path / "check"
    sources = [str(folder / name) for name in ("agent.c", "agent_check.c")]
    subprocess.run([*clang, "-O2", *FLAGS, *sources, "-o", str(built), "-lm"], check=True)
    run = subprocess.run([str(built)], check=True, capture_output=True, text=True)
    assert "500 of 500 golden pairs" in run.stdout


@pytest.mark.slow
@pytest.mark.parametrize(("table", "factor"), [("trunk_0_weight", 1.05), ("mean", 2.0)])
def test_a_changed_table_is_found(folder: Path, tmp_path: Path, table: str, factor: float) -> None:
    for name in C_FILES:
        text = (folder / name).read_text("utf-8")
        head, mark, rest = text.partition(f" t_{table}[")
        if mark:
            numbers, _, end = rest.partition("};")
            size, _, values = numbers.partition("= {")
            changed = ", ".join(
                f"{float(x.strip().rstrip('F')) * factor:.9e}F" for x in values.split(",")
            )
            text = f"{head}{mark}{size}= {{{changed}}};{end}"
        (tmp_path / name).write_text(text)
    assert (tmp_path / "agent.c").read_text() != (folder / "agent.c").read_text()
    with pytest.raises(ConfigError, match=r"agent\.c is wrong: .* of 500 golden pairs"):
        compiled_check(tmp_path)


def test_it_needs_mathematics_alone(folder: Path, tmp_path: Path) -> None:
    """Neither allocation nor anything else of a system."""
    built = tmp_path / "agent.o"
    subprocess.run(
        ["cc", "-O2", *FLAGS, "-c", str(folder / "agent.c"), "-o", str(built)], check=True
    )
    symbols = subprocess.run(
        ["nm", "-u", str(built)], capture_output=True, text=True, check=True
    ).stdout.split()
    foreign = {name for name in symbols if name != "U"}
    mathematics = {"tanhf", "expf", "expm1f", "fmaxf", "fminf"}
    # A compiler may clear and copy arrays by these two, which every C library for bare metal has.
    assert foreign <= mathematics | {
        "memcpy",
        "memset",
        "_GLOBAL_OFFSET_TABLE_",
        "__stack_chk_fail",
    }


def test_wild_readings_are_taken_as_in_numpy(folder: Path) -> None:
    """Command by command, beside agent.py, with errors of measurement among the readings."""
    code = library(folder)
    header = (folder / "agent.h").read_text("utf-8")
    width, commands, memory = (
        int(header.partition(f"#define RANS_{name} ")[2].split()[0])
        for name in ("OBSERVATION", "COMMANDS", "MEMORY")
    )
    state = np.zeros(memory + width + 1, np.float32)
    code.rans_agent_reset(pointer(state))
    agent = exported(folder)["Agent"]()
    _, _, seen = remembering()
    rows = seen[:60, 0].copy()
    rows[0, 3] = np.nan  # before there is one to hold
    rows[10, 6] = 1e9
    rows[20:24, 2] = -np.inf
    column = json.loads((folder / "contract.json").read_text("utf-8"))["observation"][6]
    # A reading, but none that it was tried on.
    rows[30, 6] = 0.5 * (column["valid"][1] + column["refused"][1])
    command = np.empty(commands, np.float32)
    found = []
    for row in rows:
        status = code.rans_agent_act(
            pointer(state), pointer(np.ascontiguousarray(row)), pointer(command)
        )
        np.testing.assert_array_equal(command, agent.act(row))
        found.append(status)
        for flag, words in (
            (HELD, "held the last one"),
            (SHUT, "shut all valves"),
            (UNTRIED, "is beyond what the agent was tried on"),
        ):
            if status & flag:
                assert words in agent.note
    assert found[0] == SHUT
    assert found[10] == HELD
    assert found[23] == SHUT
    assert found[24] == found[11] == 0
    assert found[30] == UNTRIED
    state[3] = np.nan
    agent.memory[0, 3] = np.nan
    assert code.rans_agent_act(pointer(state), pointer(rows[40].copy()), pointer(command)) == 4
    np.testing.assert_array_equal(command, agent.act(rows[40]))
    assert agent.note == "the memory was not finite and is forgotten."
    np.testing.assert_allclose(state[:memory], agent.memory[0], rtol=0, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("title", ["*/ int main(void) { return 7; } /*", "??/\n#error"])
def test_names_of_strangers_are_no_code_in_c(title: str, tmp_path: Path) -> None:
    network, _, seen = remembering()
    craft = RunFolder(pretrained_folder("go-to-pose-2d-faults")).spacecraft()
    program = agent_program(network, craft)
    write_c(tmp_path, program, network.architecture, title, pairs=golden(network, seen, craft))
    assert "500 of 500" in compiled_check(tmp_path)


def test_an_agent_leaves_as_c(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*FAST, "c", "--output", str(tmp_path / "mine")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "500 of 500 golden pairs come out as they should" in said
    assert {file.name for file in (tmp_path / "mine").iterdir()} == {
        *C_FILES,
        "spacecraft.toml",
        "contract.json",
        "golden.json",
        "card.json",
    }
    header = (tmp_path / "mine/agent.h").read_text("utf-8")
    assert "6  dx, m, frame W: p_WG - p_WB: position of the goal minus own" in header


def test_an_answer_that_is_not_finite_shuts_the_valves(folder: Path, tmp_path: Path) -> None:
    call = "rans_agent_answer(agent->last, agent->memory, command, after);"
    text = (folder / "agent.c").read_text("utf-8")
    assert text.count(call) == 1
    (tmp_path / "agent.c").write_text(text.replace(call, f"{call}\n    command[1] = NAN;"))
    shutil.copy(folder / "agent.h", tmp_path)
    code = library(tmp_path)
    _, _, seen = remembering()
    row = np.ascontiguousarray(seen[0, 0])
    state = np.zeros(4096, np.float32)
    command = np.full(64, 7.0, np.float32)
    code.rans_agent_reset(pointer(state))
    status = code.rans_agent_act(pointer(state), pointer(row), pointer(command))
    assert status & SHUT
    assert status & FORGOTTEN
    assert set(command.tolist()) == {0.0, 7.0}  # every command is 0, and nothing else was written
