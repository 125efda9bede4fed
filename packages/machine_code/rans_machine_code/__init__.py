"""Machine code on CPUs, written with LLVM (entry point of the group ``rans.machine_code``)."""
