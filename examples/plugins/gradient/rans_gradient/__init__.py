"""Learner of RANS by the gradient of the simulation: `rans train --set algorithm=gradient`."""
