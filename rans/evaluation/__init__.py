"""Evaluation of flights: metrics, comparison, assurance and stress."""
