"""Assurance of agents: failure bounds, robustness sweeps, recoverable faults, and paths."""
