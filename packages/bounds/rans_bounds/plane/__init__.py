"""Certified bounds of on/off control in the plane, by branch and bound over attitude."""
