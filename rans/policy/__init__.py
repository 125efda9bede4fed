"""Policies: specification, preprocessing, filters, symmetry, networks, heads and memory."""
