"""Published protocols and other simulators, flown and timed beside this package."""
