"""Bounds of missions beside flights, and flights that attain them."""
