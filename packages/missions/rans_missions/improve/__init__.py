"""The cheapest flight that a local search finds: `rans improve`."""
