"""Words among which an argument of a function, and the option of a command of its name, choose.

They need no library, so that the help of a command loads none.
"""

from typing import Literal

EngineName = Literal["fast", "drake"]
"""What computes a motion: RANS's own equations, or Drake."""
ProtocolName = Literal["own", "paper", "original"]
"""Setups of evaluations, see `rans.evaluation.fly.protocols`."""
Quality = Literal["quick", "good", "best"]
"""Training effort: seconds, minutes on two CPU cores, or minutes on a GPU."""
