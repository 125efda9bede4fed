"""Agents on robots: a node that flies an agent over a bus, and a twin of the robot to fly it against."""
