"""Optimal control: optimal trajectories, certified bounds, and classical controllers."""
