"""Comparisons of contestants from the same starts, with optima and certified bounds."""
