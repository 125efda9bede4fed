"""Exported C on a Cortex-M7: instructions of a command, stack and size: ``python -m campaigns.cortex``.

Agents are exported as C and compiled for the processor by the clang of the package ziglang, and run by the package
unicorn, which is made from QEMU. This command alone needs both: ``pip install ziglang unicorn``. Commands are
compared with golden.json. The first run compiles the C library, which takes minutes.
"""

from __future__ import annotations

import struct
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro
from tyro.conf import Positional

from campaigns.command import ended
from rans.deploy.export import write_export
from rans.errors import ConfigError, is_installed
from rans.evaluation.fly.contestant_name import ContestantName
from rans.files import read_bytes, read_json, write_text
from rans.terminal import Terminal

_TARGET = "-target", "thumb-linux-musleabihf", "-mcpu=cortex_m7+fp_armv8d16"
"""A Cortex-M7 with its unit for floating-point numbers, such as that of an STM32H7."""
_CLOCK = 216e6
"""Hz, of an STM32F7; one instruction a cycle is assumed, as the processor's memory is not emulated."""
_ENTRY = """#include "agent.h"
const volatile unsigned rans_state = sizeof(rans_agent);
int main(void)
{
    static rans_agent agent;
    static float observation[RANS_OBSERVATION], command[RANS_COMMANDS];
    rans_agent_reset(&agent);
    return rans_agent_act(&agent, observation, command) + (int)rans_state;
}
"""
"""Program that keeps the agent's functions when it is linked; it is never started."""
_STACK, _DATA, _END = 0x20000000, 0x30000000, 0x003F0000
"""Addresses: of the stack, of what the agent is called with, and where a call returns to."""
_ROOM = 0x10000
"""Bytes of each."""
_FRESH = 0xA5
"""Byte that the stack is filled with: it was used down to the first other one."""
_LARGEST = 2**24
"""Bytes of a compiled program."""
_HEADINGS = (
    "craft",
    "compiled by",
    "code and constants, kB",
    "state, bytes",
    "stack, bytes",
    "instructions of a command: median, most",
    "at 216 MHz, ms",
    "commands of golden.json",
)


class Elf:
    """Sections and symbols of a 32-bit little-endian ELF file.

    Raises:
        ConfigError: the bytes are no such file.
    """

    def __init__(self, content: bytes) -> None:
        if content[:6] != b"\x7fELF\x01\x01":
            raise ConfigError("the compiled program is no 32-bit little-endian ELF file.")
        self.content = content
        first, sections = struct.unpack_from("<II", content, 28)
        segments, _, count = struct.unpack_from("<HHH", content, 44)
        self._segments = [
            struct.unpack_from("<8I", content, first + 32 * k) for k in range(segments)
        ]
        self._sections = [
            struct.unpack_from("<10I", content, sections + 40 * k) for k in range(count)
        ]

    def loaded(self) -> list[tuple[int, bytes]]:
        """Addresses and bytes of what is loaded."""
        return [
            (address, self.content[offset : offset + size])
            for kind, offset, address, _, size, *_ in self._segments
            if kind == 1
        ]

    def allocated(self) -> int:
        """Bytes of the sections that are in the processor's memory: code, constants and data."""
        return sum(size for _, _, flags, _, _, size, *_ in self._sections if flags & 2)

    def symbols(self) -> dict[str, int]:
        """Address of every symbol."""
        found = {}
        for _, kind, _, _, offset, size, link, *_ in self._sections:
            if kind != 2:
                continue
            names = self._sections[link][4]
            for at in range(offset, offset + size, 16):
                name, value = struct.unpack_from("<II", self.content, at)
                end = self.content.index(b"\0", names + name)
                found[self.content[names + name : end].decode()] = value
        return found


def instructions(code: bytes) -> int:
    """Number of Thumb-2 instructions: two bytes each, or four where the first five bits are 0b11101 or more."""
    count = 0
    at = 0
    while at < len(code):
        at += 4 if code[at + 1] >> 3 >= 0b11101 else 2
        count += 1
    return count


class Processor:
    """An emulated Cortex-M7 with a program in its memory; ``count`` is of the instructions since it was set."""

    def __init__(self, program: Elf) -> None:
        unicorn = import_module("unicorn")
        arm = import_module("unicorn.arm_const")
        self._symbols = program.symbols()
        self._arguments = arm.UC_ARM_REG_R0, arm.UC_ARM_REG_R1, arm.UC_ARM_REG_R2
        self._pointer, self._link = arm.UC_ARM_REG_SP, arm.UC_ARM_REG_LR
        self._emulator: Any = unicorn.Uc(
            unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS
        )
        self._emulator.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M7)
        # The unit for floating-point numbers is off after a reset.
        self._emulator.reg_write(arm.UC_ARM_REG_FPEXC, 0x40000000)
        for address, room in ((0, _END + _ROOM), (_STACK, _ROOM), (_DATA, _ROOM)):
            self._emulator.mem_map(address, room)
        for address, content in program.loaded():
            self._emulator.mem_write(address, content)
        self._emulator.mem_write(_STACK, bytes([_FRESH]) * _ROOM)
        self.count = 0
        known: dict[tuple[int, int], int] = {}

        def begun(emulator: Any, address: int, size: int, _: Any) -> None:
            if (address, size) not in known:
                known[address, size] = instructions(bytes(emulator.mem_read(address, size)))
            self.count += known[address, size]

        # Called for every block of instructions without a jump.
        self._emulator.hook_add(unicorn.UC_HOOK_BLOCK, begun)

    def number(self, name: str) -> int:
        """Value of an unsigned integer of the program."""
        return int.from_bytes(self.read(self._symbols[name], 4), "little")

    def read(self, address: int, size: int) -> bytes:
        """Bytes of the memory."""
        return bytes(self._emulator.mem_read(address, size))

    def write(self, address: int, content: bytes) -> None:
        """Write into the memory."""
        self._emulator.mem_write(address, content)

    def call(self, name: str, *addresses: int) -> None:
        """Call a function of the program with up to three pointers."""
        for register, address in zip(self._arguments, addresses, strict=False):
            self._emulator.reg_write(register, address)
        self._emulator.reg_write(self._pointer, _STACK + _ROOM)
        self._emulator.reg_write(self._link, _END | 1)
        self._emulator.emu_start(self._symbols[name] | 1, _END)

    def used(self) -> int:
        """Bytes of the stack that calls have used."""
        stack = self.read(_STACK, _ROOM)
        return len(stack.lstrip(bytes([_FRESH])))


class Row(NamedTuple):
    """What a compiled agent needs."""

    size: int
    """Code and constants, bytes."""
    state: int
    """Size of the struct rans_agent, bytes."""
    stack: int
    """Largest stack, bytes, with those of tanhf and logf."""
    counts: tuple[int, ...]
    """Instructions of every command."""
    equal: int
    """Number of commands that are those of golden.json."""

    def cells(self) -> list[str]:
        """As the table has them, without the craft and the flag."""
        median = float(np.median(self.counts))
        return [
            f"{self.size / 1000:.1f}",
            str(self.state),
            f"{self.stack:,}",
            f"{median:,.0f}, {max(self.counts):,}",
            f"{1e3 * median / _CLOCK:.2f}",
            f"{self.equal} of {len(self.counts)}",
        ]


def measured(folder: Path, flag: str, every: int = 1) -> Row:
    """Compile agent.c of a folder with a flag of optimization, and run it on every so many golden pairs.

    Raises:
        ConfigError: the compiler refuses the files.
    """
    with tempfile.TemporaryDirectory() as build:
        entry, part, program = (Path(build) / name for name in ("entry.c", "agent.o", "agent.elf"))
        write_text(entry, _ENTRY)
        _compiled(flag, "-c", str(folder / "agent.c"), "-o", str(part))
        _compiled(
            *("-O2", "-static", f"-I{folder}", str(entry), str(part), "-lm", "-o", str(program))
        )
        size = Elf(read_bytes(part, _LARGEST)).allocated()
        processor = Processor(Elf(read_bytes(program, _LARGEST)))
    golden = read_json(folder / "golden.json")
    observations = np.array(golden["observation"], np.float32)
    commands = np.array(golden["command"], np.float32)
    agent, observed, commanded = (_DATA + 0x4000 * k for k in range(3))
    # Pairs of an agent with a memory follow each other from where an episode begins.
    count = len(observations)
    begins = np.array(golden["begins"], bool)
    remembers = read_json(folder / "contract.json")["memory"] > 0
    chosen = range(count // every) if remembers else range(0, count, every)
    counts = []
    equal = 0
    for observation, command, is_first in zip(
        *(x[chosen] for x in (observations, commands, begins)), strict=True
    ):
        if is_first or not remembers:
            processor.call("rans_agent_reset", agent)
        processor.write(observed, observation.tobytes())
        processor.count = 0
        processor.call("rans_agent_act", agent, observed, commanded)
        counts.append(processor.count)
        answer = np.frombuffer(processor.read(commanded, command.nbytes), np.float32)
        equal += bool((np.abs(answer - command) <= golden["tolerance"]).all())
    return Row(size, processor.number("rans_state"), processor.used(), tuple(counts), equal)


def _compiled(*arguments: str) -> None:
    command = [sys.executable, "-m", "ziglang", "cc", *_TARGET, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ConfigError(f"clang refuses the agent: {done.stderr.strip()[:300]}")


@dataclass(frozen=True)
class Cortex:
    """Measure exported agents, and print the table."""

    agents: Positional[tuple[str, ...]] = (
        "any-craft-2d@floating-platform",
        "any-craft-2d@pingu",
        "any-craft-3d@spheres",
        "any-craft-3d@free-flyer",
    )
    """Names of agents."""
    every: int = 5
    """Every so many of the 500 golden pairs are commanded."""

    def run(self) -> int:
        """Print; 1 if a command is another one than that of golden.json."""
        if missing := [name for name in ("ziglang", "unicorn") if not is_installed(name)]:
            raise ConfigError(
                f"{' and '.join(missing)} compile and run the agents, and are not installed here: "
                "pip install ziglang unicorn."
            )
        rows = []
        right = True
        for agent in self.agents:
            with tempfile.TemporaryDirectory() as above:
                folder = Path(above) / "agent"
                source = ContestantName.parse(agent).folder
                write_export(source, folder, "c", episodes=8, margins=0)
                for flag in ("-Os", "-O2"):
                    row = measured(folder, flag, self.every)
                    right = right and row.equal == len(row.counts)
                    rows.append([agent.rpartition("@")[2], flag, *row.cells()])
        Terminal(room=150).show("C on a Cortex-M7", _HEADINGS, rows)
        return 0 if right else 1


if __name__ == "__main__":
    raise SystemExit(ended("cortex", lambda: tyro.cli(Cortex).run()))
