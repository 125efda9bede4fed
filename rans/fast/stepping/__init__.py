"""The step of an engine: in single operations, as machine code on a CPU, and as one kernel on a GPU."""
