"""Robustness: success of contestants against the size of every disturbance and fault."""
