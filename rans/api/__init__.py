"""Functions behind the commands: each takes names, files or objects, and returns its result.

They are at the top of the package (``rans.evaluate``), load what they need when they are called, and show
progress on a terminal and in a notebook.
"""

from rans.api.agent import Agent, load_agent
from rans.api.drafting import init_spacecraft, join_spacecraft
from rans.api.identification import excite, identify
from rans.api.judging import benchmark, compare, evaluate, validate
from rans.api.limits import certify, optimal_trajectory, state
from rans.api.pages import export, report, view
from rans.api.training import sweep, train, tune

__all__ = [
    "Agent",
    "benchmark",
    "certify",
    "compare",
    "evaluate",
    "export",
    "identify",
    "excite",
    "init_spacecraft",
    "join_spacecraft",
    "load_agent",
    "optimal_trajectory",
    "report",
    "state",
    "sweep",
    "train",
    "tune",
    "validate",
    "view",
]
