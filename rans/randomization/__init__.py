"""What an episode draws: the body, thruster faults, delays, disturbances and sensor errors."""
