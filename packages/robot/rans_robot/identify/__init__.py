"""Identification of a spacecraft from logs of its flights.

`log.py` reads a log, `motion.py` predicts the motion between its readings, `fit.py` fits forces, inertia and
delays to them, and `result.py` turns the fit into a spacecraft and conditions to train for.
"""
