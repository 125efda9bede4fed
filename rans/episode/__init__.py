"""An episode from its start to its verdict: scenario, step, flight, environment, frames of the motion."""
