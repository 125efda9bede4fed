"""Trainers on the engine's device."""
