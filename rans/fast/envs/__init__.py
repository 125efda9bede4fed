"""Interfaces of the engine for Gymnasium and Stable-Baselines3."""
