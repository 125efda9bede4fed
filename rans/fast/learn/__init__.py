"""Trainers on the engine's device, for one agent or many at once."""
