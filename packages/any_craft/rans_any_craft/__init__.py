"""Agents for any craft: their training, and spacecraft of other software's files."""
