"""NASA's JEOD as a judge of orbits: its figures, its logs, and how far ours is from both."""
