"""What this package gives the engine, networks, learners and flights of a processor."""

from __future__ import annotations

from rans.extend import MachineCode, is_installed


def machine_code() -> MachineCode | None:
    """Functions that write machine code; None without llvmlite."""
    if not is_installed("llvmlite"):
        return None
    from rans_machine_code.flights import FLOWN, CpuFlights
    from rans_machine_code.gradient import gradient
    from rans_machine_code.preprocessor import CpuPreprocessor
    from rans_machine_code.step import CompiledStep

    return MachineCode(CompiledStep, CpuPreprocessor, gradient, FLOWN, CpuFlights)
