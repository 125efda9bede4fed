"""Missions near targets and moons: tasks, guidance, passive safety, safety filter, bounds, CCSDS messages."""
