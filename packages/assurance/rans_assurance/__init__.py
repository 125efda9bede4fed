"""Assurance of agents: failure bounds, robustness sweeps, worst cases, recoverable faults, and paths."""
