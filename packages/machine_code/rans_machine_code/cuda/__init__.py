"""The whole step of an engine as one GPU kernel, generated from the equations the other engines run."""
