"""Agents as modules of PX4, the autopilot."""
