"""An exported agent as C99."""
