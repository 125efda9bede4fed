"""Judges of orbits and liquid: figures of JEOD and Basilisk, and how far ours is from them."""
