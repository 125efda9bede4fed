"""Certified bounds of on/off control in space, for craft that turn alike about every axis."""
