"""Adaptation in flight of the agents for any craft, and spacecraft of other software's files."""
