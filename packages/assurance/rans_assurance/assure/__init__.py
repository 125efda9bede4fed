"""Assurance: failure probability with exact bounds, replays, rare events and the smallest breaking disturbance."""
