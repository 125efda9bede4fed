"""Campaigns whose figures the documents print: each writes a file in docs/validation."""
