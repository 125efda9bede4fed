"""What is physically possible: optimal trajectories, and controllers that no agent may ignore."""
