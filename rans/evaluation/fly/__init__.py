"""Controllers and agents that can be evaluated, and the flights of their episodes."""
