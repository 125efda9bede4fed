"""Learner of RANS by fitted value iteration with the exact model: `rans train --set algorithm=value`."""
