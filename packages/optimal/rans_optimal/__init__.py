"""Optimal control by CasADi: trajectories of relaxed commands by direct multiple shooting, and MPC."""
