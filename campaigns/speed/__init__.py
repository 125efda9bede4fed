"""Campaigns behind the figures of speed that documents give."""
