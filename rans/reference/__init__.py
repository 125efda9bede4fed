"""The Drake reference: an independent simulation of the same spacecraft."""
