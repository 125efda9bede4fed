"""Controllers of optimal and classical control that need no training."""
