"""Paths, and agents that follow them."""
