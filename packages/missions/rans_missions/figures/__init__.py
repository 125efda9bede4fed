"""Figures of missions in comparisons: paths on orbits, and landings."""
