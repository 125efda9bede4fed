"""Figures of the results of this package."""
