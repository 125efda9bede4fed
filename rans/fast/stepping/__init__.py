"""An engine's step: as written, as machine code on a CPU, and as one kernel on a GPU."""
