import os

# Matrices are small and tests run side by side: more threads only wait for each other, and burn processor
# time while they do. Read when NumPy and torch load, also by the processes that tests start.
for library in ("OMP", "OPENBLAS", "MKL", "VECLIB"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
# As in every command of ours: torch's compiler would start a process for each core.
os.environ.setdefault("TORCHINDUCTOR_COMPILE_THREADS", "1")
