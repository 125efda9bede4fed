"""Optimal trajectories of relaxed commands, by direct multiple shooting."""
