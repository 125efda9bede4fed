"""Agents that follow a circle."""
