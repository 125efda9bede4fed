"""Controllers that need no training."""
