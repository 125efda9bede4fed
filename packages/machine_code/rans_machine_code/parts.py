"""What this package gives the engine, networks, learners and flights, by the type of their device."""

from __future__ import annotations

from rans.extend import MachineCode, is_installed


def machine_code(device: str) -> MachineCode | None:
    """Functions that write machine code: of a CPU with llvmlite, of a GPU with CUDA; None of other devices."""
    if device == "cuda":
        from rans_machine_code.cuda.flight import FlightKernel
        from rans_machine_code.cuda.gradient import matrix_gradient
        from rans_machine_code.cuda.preprocessor import CudaPreprocessor
        from rans_machine_code.cuda.step import Kernel

        return MachineCode(Kernel.made, CudaPreprocessor, matrix_gradient, FlightKernel.made)
    if device != "cpu" or not is_installed("llvmlite"):
        return None
    from rans_machine_code.flights import cpu_flights
    from rans_machine_code.gradient import gradient
    from rans_machine_code.preprocessor import preprocessor
    from rans_machine_code.step import CompiledStep

    return MachineCode(CompiledStep, preprocessor, gradient, cpu_flights)
