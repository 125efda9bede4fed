"""Learner of RANS by the gradient of the simulation: `rans train --algorithm gradient`."""
