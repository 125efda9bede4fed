"""How surely an agent does not fail: counts, exact bounds, replays, rarer events and the worst case."""
