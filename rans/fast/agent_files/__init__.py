"""Files of agents: read and written without running anything that they hold."""
