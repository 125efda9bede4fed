"""Machine code on CPUs, written with LLVM.

Without it the equations run on NumPy's arrays and networks in torch, with equal results and slower.

Raises:
    MissingPackage: when it is imported, where llvmlite is missing.
"""

from rans.errors import require

require("llvmlite")
