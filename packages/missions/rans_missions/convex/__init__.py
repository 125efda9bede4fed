"""Trajectories that are optimal with a proof: convex programs, their lower bounds and what the bounds leave open.

Each module states one problem in cones and solves it with Clarabel (Goulart and Chen, "Clarabel: An interior-point
solver for conic programs with quadratic objectives", 2024), whose dual solution is a lower bound of its own.
"""
