"""Spacecraft, flights, oracles and stand-ins that several files of tests share."""
