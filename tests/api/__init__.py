"""Tests of what is at the top of the package."""
