"""Plug-ins of ``examples/plugins``, registered in this process as an installed package would register them."""

from __future__ import annotations

from rans_gradient.learner import Gradient
from rans_imitation.learner import Imitation

from rans.fast.learn.algorithms import LEARNERS


def register() -> None:
    """Register the learners unless another module of tests has."""
    for name, kind in (("gradient", Gradient), ("imitation", Imitation)):
        if name not in LEARNERS:
            LEARNERS.register(name)(kind)
