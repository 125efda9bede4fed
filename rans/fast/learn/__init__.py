"""Trainers on the engine's device, and sweeps of them."""
