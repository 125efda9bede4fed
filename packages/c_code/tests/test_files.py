"""agent.c: what it needs, what it does with wild readings, and names of strangers in it."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import subprocess
from functools import cache, partial
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, strategies as st
from rans_any_craft.networks import for_craft
from rans_c_code.compiler import FLAGS, loaded_size
from rans_c_code.compressed import Packed, Stepped, in_steps
from rans_c_code.files import filled, write_c
from rans_c_code.formats import C
from rans_c_code.text import DIALECT
from scipy.spatial.transform import Rotation

from rans.base.files import plain
from rans.base.pretrained import pretrained_folder
from rans.cli import main
from rans.deploy.contract import contract, golden
from rans.deploy.export import stack_of
from rans.deploy.program import Ports, agent_program
from rans.evaluation.fly.contestants import contestant
from rans.fast.learn.run_folder import RunFolder
from rans.model.operations import ROWS, of_row
from rans.model.spacecraft_file import load_spacecraft
from tests.support.exports import FAST, exported, remembering, written
from tests.support.operations import check, compiled
from tests.support.processes import PATIENCE

if shutil.which("cc") is None:
    pytest.skip("needs a C compiler", allow_module_level=True)

HELD, SHUT, FORGOTTEN, UNTRIED, UNREADY = 1, 2, 4, 8, 16
PX4_FLAGS = (
    *("-Wall", "-Wextra", "-Werror", "-Warray-bounds", "-Wcast-align", "-Wdisabled-optimization"),
    *("-Wdouble-promotion", "-Wfloat-equal", "-Wformat-security", "-Winit-self", "-Wlogical-op"),
    *("-Wpointer-arith", "-Wshadow", "-Wuninitialized", "-Wunused-variable"),
    *("-funsafe-math-optimizations", "-fno-strict-aliasing", "-fno-math-errno"),
)
"""Of PX4-Autopilot, cmake/px4_add_common_flags.cmake."""
BUILDS = {
    "PX4": ["gcc", "-O2", "-std=gnu11", *PX4_FLAGS, "-Wbad-function-cast", "-Wstrict-prototypes"],
    "C++": ["g++", "-x", "c++", "-Ofast", "-std=c++17", *PX4_FLAGS],
}


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
    write_c(path, program, Ports.of(network.architecture), "it", json.dumps(about), pairs)
    return path


@cache
def library(folder: Path, *flags: str) -> ctypes.CDLL:
    part = folder / "agent.o"
    built = folder / f"agent{''.join(flags)}.so"
    source = str(folder / "agent.c")
    subprocess.run(
        ["cc", "-O2", *FLAGS, *flags, "-fPIC", "-c", source, "-o", str(part)], check=True
    )
    # Linked without the flags: with -ffast-math it would set this whole process to round small numbers to zero.
    subprocess.run(["cc", "-shared", str(part), "-o", str(built), "-lm"], check=True)
    return ctypes.CDLL(str(built))


def pointer(values: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


def checked(command: list[str], folder: Path, built: Path) -> str:
    """What agent_check.c prints, built by a command."""
    sources = [str(folder / name) for name in ("agent.c", "agent_check.c")]
    subprocess.run([*command, *sources, "-o", str(built), "-lm"], check=True)
    return subprocess.run([str(built)], check=True, capture_output=True, text=True).stdout


@pytest.mark.slow
@pytest.mark.parametrize("build", BUILDS)
def test_golden_pairs_come_out_of_firmwares_builds(
    folder: Path, tmp_path: Path, build: str
) -> None:
    command = BUILDS[build]
    if shutil.which(command[0]) is None:
        pytest.skip(f"needs {command[0]}")
    assert "160 of 160 golden pairs" in checked(command, folder, tmp_path / "check")


VECTORS = """
extern void _start(void);
void reset(void);
__attribute__((section(".vectors"), used)) void *const vectors[2] = {(void *)0x20400000, reset};
void reset(void)
{
    *(volatile unsigned *)0xE000ED88 |= 0xFU << 20; /* CPACR: the floating-point unit is on */
    __asm volatile("dsb\\n isb");
    _start();
}
"""
"""Beginning of a Cortex-M without an operating system: stack at the end of 4 MB of memory, then newlib's start."""


@pytest.mark.slow
def test_golden_pairs_come_out_of_a_microcontroller(folder: Path, tmp_path: Path) -> None:
    """A Cortex-M7 as qemu emulates it, with the flags of an autopilot."""
    missing = [x for x in ("arm-none-eabi-gcc", "qemu-system-arm") if shutil.which(x) is None]
    if missing:
        pytest.skip(f"needs {' and '.join(missing)}")
    (tmp_path / "start.c").write_text(VECTORS)
    # "rdimon" prints through the debugger.
    command = ["arm-none-eabi-gcc", "-O2", "-std=gnu11", *PX4_FLAGS, "--specs=rdimon.specs"]
    command += ["-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-sp-d16"]
    command += ["-Wl,--section-start=.vectors=0"]
    sources = [folder / "agent.c", folder / "agent_check.c", tmp_path / "start.c"]
    built = tmp_path / "check.elf"
    subprocess.run([*command, *map(str, sources), "-o", str(built), "-lm"], check=True)
    emulator = ["qemu-system-arm", "-M", "mps2-an500", "-nographic", "-kernel", str(built)]
    emulator += ["-semihosting-config", "enable=on,target=native", "-monitor", "none"]
    run = subprocess.run(emulator, check=True, capture_output=True, text=True, timeout=PATIENCE)
    assert "160 of 160 golden pairs" in run.stdout + run.stderr


@pytest.mark.slow
def test_a_struct_without_a_reset_shuts_the_valves(folder: Path) -> None:
    """Of zeros, of ones, of what an overwritten counter holds; until it is reset."""
    code = library(folder)
    _, _, seen = remembering()
    row = np.ascontiguousarray(seen[0, 0])
    for content in (0, 0xFFFFFFFF, 0x7FC00000, 0x80000000):
        state = np.full(4096, content, np.uint32)
        command = np.full(64, 7.0, np.float32)
        status = code.rans_agent_act(pointer(state), pointer(row), pointer(command))
        assert status == SHUT | UNREADY
        assert set(command.tolist()) == {0.0, 7.0}
    code.rans_agent_reset(pointer(state))
    assert code.rans_agent_act(pointer(state), pointer(row), pointer(command)) == 0
    header = (folder / "agent.h").read_text("utf-8")
    width, memory = (defined(header, name) for name in ("OBSERVATION", "MEMORY"))
    for held in (-(2**31), -1, 2**31 - 1):  # after the mark, the memory and the last reading
        state.view(np.int32)[1 + memory + width] = held
        status = code.rans_agent_act(pointer(state), pointer(row), pointer(command))
        assert status == SHUT | UNREADY


@pytest.mark.slow
def test_it_needs_mathematics_alone(folder: Path) -> None:
    """Neither allocation nor anything else of a system."""
    library(folder)
    command = ["nm", "-u", str(folder / "agent.o")]
    foreign = set(subprocess.check_output(command, text=True).split()) - {"U"}
    mathematics = {"tanhf", "expf", "expm1f", "fmaxf", "fminf"}
    # A compiler may clear and copy arrays by these two, which every C library for bare metal has.
    assert foreign <= mathematics | {
        "memcpy",
        "memset",
        "_GLOBAL_OFFSET_TABLE_",
        "__stack_chk_fail",
    }


def defined(header: str, name: str) -> int:
    """A number of agent.h."""
    return int(header.partition(f"#define RANS_{name} ")[2].split()[0])


@pytest.mark.slow
@pytest.mark.parametrize("flags", [(), ("-ffast-math",)])
def test_wild_readings_are_taken_as_in_numpy(folder: Path, flags: tuple[str, ...]) -> None:
    """Command by command, beside agent.py, with errors of measurement among the readings."""
    code = library(folder, *flags)
    header = (folder / "agent.h").read_text("utf-8")
    names = ("OBSERVATION", "COMMANDS", "MEMORY")
    width, commands, memory = (defined(header, name) for name in names)
    state = np.zeros(1 + memory + width + 2, np.float32)
    code.rans_agent_reset(pointer(state))
    agent = exported(folder)["Agent"]()
    _, _, seen = remembering()
    rows = seen[:60, 0].copy()
    rows[33:38] = rows[32]
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
            (HELD, "held the last"),
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
    assert found[33] == HELD
    assert found[37] == SHUT
    state[1 + 3] = np.nan
    agent.memory[0, 3] = np.nan
    assert code.rans_agent_act(pointer(state), pointer(rows[38].copy()), pointer(command)) == 4
    np.testing.assert_array_equal(command, agent.act(rows[38]))
    assert agent.note == "the memory was not finite and is forgotten."
    np.testing.assert_allclose(state[1 : 1 + memory], agent.memory[0], rtol=0, atol=1e-6)


@pytest.mark.slow
def test_an_agent_leaves_as_c(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*FAST, "c", "--output", str(tmp_path / "mine")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "160 of 160 golden pairs come out as they should" in said
    assert {file.name for file in (tmp_path / "mine").iterdir()} == {
        *C.files,
        "spacecraft.toml",
        "contract.json",
        "golden.json",
        "card.json",
    }
    header = (tmp_path / "mine/agent.h").read_text("utf-8")
    assert "6  dx, m, frame W: p_WG - p_WB: position of the goal minus own" in header
    assert "2  v_x, m/s, frame W: v_WB, own velocity" in header
    stated = stack_of(tmp_path / "mine")
    about = json.loads((tmp_path / "mine/contract.json").read_text("utf-8"))
    assert about["c"]["stack"] == stated
    assert f"It needs {stated:,} bytes of stack." in said


@pytest.mark.slow
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


@pytest.mark.parametrize("name", ["free-flyer", pytest.param("spheres", marks=pytest.mark.slow)])
def test_the_agent_for_any_craft_fits_a_small_microcontroller(name: str, tmp_path: Path) -> None:
    """50 kB of code and constants by binutils' size, 4 KiB of stack, and the network's own commands."""
    run = contestant("pretrained:any-craft-3d")
    made = for_craft(run.network, load_spacecraft(name), 0.2)
    write_c(tmp_path, agent_program(made), Ports.of(made.architecture), "it")
    built = library(tmp_path)
    if shutil.which("size"):
        printed = subprocess.run(
            ["size", str(tmp_path / "agent.o")], capture_output=True, text=True, check=True
        ).stdout
        # Columns: text with constants, data, bss.
        assert [int(x) for x in printed.splitlines()[1].split()[1:3]] == [0, 0]
        assert int(printed.split()[6]) < 50_000
    assert (stack_of(tmp_path) or 0) <= 4096
    random = np.random.default_rng(3)
    turns = Rotation.random(400, rng=random).as_matrix()[:, :2].reshape(2, 200, 6)
    rates, way = random.normal(size=(200, 6)), random.normal(size=(200, 3))
    seen = np.hstack([turns[0], 0.2 * rates, np.ones((200, 1)), way, turns[1]]).astype(np.float32)
    expected, _ = made.deterministic_action(torch.tensor(seen), None)
    array = np.ctypeslib.ndpointer(np.float32, flags="C")
    answer = built.rans_agent_answer
    answer.argtypes = [array, ctypes.c_void_p, array, ctypes.c_void_p]
    found = np.zeros(expected.shape, np.float32)
    for row, command in zip(seen, found, strict=True):
        answer(row, None, command, None)
    assert len(np.unique(found, axis=0)) > 50
    # Sums in another order may choose another subset that is equally good.
    assert np.isclose(found, expected.numpy(), atol=1e-3).all(axis=1).mean() > 0.99


def test_tables_of_few_numbers_are_stored_without_loss() -> None:
    """By the C expression of every entry, read as Python, with blocks that are alike and that are not."""
    random = np.random.default_rng(0)
    block = random.integers(0, 9, (4, 30))
    alike = random.normal(size=(3, 9)).astype(np.float32)[:, block].reshape(12, 30)
    unlike = alike.copy()
    unlike[7] = unlike[7, ::-1]
    bits = random.choice(np.array([-0.5, 0.5], np.float32), (40, 7))
    zeros = np.where(bits > 0.0, np.float32(0.0), np.float32(-0.0))
    three = random.choice(np.array([-0.5, 0.5, 1.0], np.float32), (40, 7))
    for table in (alike, unlike, bits, zeros, bits[:, :1], three):
        packed = Packed.of(np.ascontiguousarray(table))
        assert packed is not None
        assert packed.bytes <= table.nbytes // 2
        arrays = {"t": packed.values.ravel(), "t_index": packed.stored}
        width = table.shape[1]
        for (i, k), number in np.ndenumerate(table):
            text = packed.entry("t", str(i), str(k), width).replace("/", "//")
            found = eval(text, arrays)
            assert (found == number, np.signbit(found)) == (True, np.signbit(number))
    # Numbers that do not repeat stay as they are.
    assert Packed.of(random.normal(size=(30, 30)).astype(np.float32)) is None


@pytest.mark.parametrize(
    "titles", ["text data bss dec hex filename", "__TEXT __DATA __OBJC others dec hex"]
)
def test_the_size_is_the_sum_that_the_program_prints(
    titles: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The programs `size` of binutils and of macOS print different columns."""
    numbers = " ".join("4321" if name == "dec" else "7" for name in titles.split())
    tool = tmp_path / "size"
    tool.write_text(f"#!/bin/sh\necho '{titles}'\necho '{numbers}'\n")
    tool.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert loaded_size(tmp_path / "agent.o") == 4321


def test_the_files_of_the_package_compile_and_fly_as_they_stand(tmp_path: Path) -> None:
    """C tools read them without Python: a small agent, whose samples are its tables and golden pairs."""
    folder = Path(str(resources.files("rans_c_code") / "data"))
    assert checked(["cc", *FLAGS], folder, tmp_path / "check")[:19] == "2 of 2 golden pairs"


def test_a_sample_is_left_replaced_or_left_out() -> None:
    text = "/* @TITLE@ */ a/*@X*/ = 1/*@*/; /*@Y*/two\nlines\n/*@*/b;"
    assert filled(text, {"TITLE": "t", "X": " = 2", "Y": True}) == "/* t */ a = 2; two\nlines\nb;"
    assert filled(text, {"TITLE": "@X@", "X": "", "Y": False}) == "/* @X@ */ a; b;"


@given(
    st.integers(1, 40),
    st.integers(2, 40),
    st.integers(0, 2**32 - 1),
    st.floats(1e-6, 1e6),
)
def test_weights_in_steps_are_stored_without_loss(
    rows: int, columns: int, seed: int, size: float
) -> None:
    """Each is at most half a step from what it was, and the C expression of every entry gives it."""
    random = np.random.default_rng(seed)
    table = (size * random.normal(size=(rows, columns))).astype(np.float32)
    table[random.integers(rows)] = 0.0
    rounded = in_steps(table)
    step = np.abs(table).max(axis=1, keepdims=True) / 127
    assert (np.abs(rounded - table) <= 0.501 * step).all()  # half a step, and rounding of float32
    stored = Stepped.of(rounded)
    assert stored is not None
    assert len(stored.stored) == table.size
    arrays = {"t": stored.values, "t_index": stored.stored.astype(np.int16)}  # as C promotes them
    for (i, k), number in np.ndenumerate(rounded):
        assert eval(stored.entry("t", str(i), str(k), columns), arrays) == number
    # Planted: an entry between two steps is none.
    rounded[0, 0] += 0.3 * max(float(step[0, 0]), 1e-3)
    rounded[0, 1] = max(float(step[0, 0]), 1e-3) * 127
    assert Stepped.of(rounded) is None


def test_an_operation_is_the_same_in_c(tmp_path: Path):
    beginning = "#include <math.h>\ntypedef float real;\n"
    check("C", DIALECT, partial(compiled, ["cc", *FLAGS], beginning), np.float32, tmp_path)
    assert not [name for name in ROWS if of_row(name) not in DIALECT]
