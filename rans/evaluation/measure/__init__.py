"""Metrics of flights, with confidence intervals."""
