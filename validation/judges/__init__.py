"""Figures of others that ours are compared with: `rans validate --judges`."""
