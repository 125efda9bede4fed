"""Kalman filters within policies (entry point ``filters`` of the group ``rans.estimators``)."""
