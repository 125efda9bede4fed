"""Missions near targets and moons: guidance, convex programs, bounds, CCSDS messages."""
