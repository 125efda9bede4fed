"""Controllers of missions that need no training."""
