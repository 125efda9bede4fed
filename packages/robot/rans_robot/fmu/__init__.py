"""Agents as functional mock-up units, which Simulink, Dymola and other simulators fly (FMI 2.0)."""
