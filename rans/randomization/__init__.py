"""Domain randomization: body, thruster faults, delays, disturbances and sensor errors of an episode."""
