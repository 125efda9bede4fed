"""Certified bounds: what no on/off controller can do better."""
