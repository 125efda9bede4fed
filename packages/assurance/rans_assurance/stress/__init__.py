"""Robustness sweeps: one disturbance at a time, at increasing magnitude."""
