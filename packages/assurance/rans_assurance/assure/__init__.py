"""Assurance: failure probability with exact bounds, replays and the smallest breaking disturbance."""
