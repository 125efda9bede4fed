"""Machine code on CPUs, written with LLVM."""
