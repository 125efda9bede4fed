"""A task, a spacecraft and a controller that RANS finds by their entry points."""
