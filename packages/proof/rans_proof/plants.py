"""Motion of sets of states over a control period: pieces of it, and the exact motion of linear plants."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor

from rans_proof.problem import Problem
from rans_proof.relaxation import Planes, Zonotope

_UNIT = 2.0**-53
_EXPONENTIAL = 64.0
"""Errors of a computed matrix exponential, in units of rounding of that of the absolute matrix: Higham, "The
scaling and squaring method revisited", 2005, finds a few where norms are about 1, as those of a period are."""


class Piece(NamedTuple):
    """Part of a control period, over which a property is checked."""

    begin: Zonotope
    end: Zonotope
    sag: Tensor
    """(B, n): at most so far is each coordinate in between from the straight line through begin and end."""


class Plant(Protocol):
    """Plant whose commands are held for a control period."""

    def move(self, states: Zonotope, planes: Planes) -> list[Piece]:
        """Pieces of one control period under commands within the planes."""
        ...


class LinearPlant:
    """Plant x' = A x + B u, moved by its matrix exponential over a control period.

    ``_widest`` and ``_second`` bound what flights do between both ends of the period; they must be no smaller.
    """

    def __init__(self, problem: Problem, device: torch.device) -> None:
        from scipy.linalg import expm

        matrices = problem.linear()
        assert matrices is not None
        drift, gain = matrices
        states = problem.states
        both = np.zeros((states + problem.commands,) * 2)
        both[:states, :states] = drift
        both[:states, states:] = gain
        whole = expm(problem.period * both)
        widest = expm(problem.period * np.abs(both))
        rates = np.abs(both)[:states] @ np.abs(both)  # of x'' from |x| and |u|

        def tensor(array: np.ndarray) -> Tensor:
            return torch.tensor(array, dtype=torch.float64, device=device)

        self._state = tensor(whole[:states, :states])
        self._command = tensor(whole[:states, states:])
        self._widest = tensor(widest[:states])
        self._second = tensor(rates @ widest * problem.period**2 / 8.0 * (1.0 + 1e-9))

    def move(self, states: Zonotope, planes: Planes) -> list[Piece]:
        """One piece: between its ends the motion is off the chord by at most max |x''| T^2 / 8.

        Its end encloses with all rounding, and its sag with the largest |x''| of the period, of which `_second` is
        the factor.
        """
        gain = self._state + self._command @ planes.gain
        centre = (gain @ states.centre[:, :, None])[:, :, 0] + planes.offset @ self._command.T
        commands = (planes.gain.abs() @ states.size[:, :, None])[:, :, 0]
        commands = commands + planes.offset.abs() + planes.error
        size = torch.cat((states.size, commands), dim=1)
        count = states.centre.shape[1] + states.generators.shape[2] + 8
        rounding = (_EXPONENTIAL + 4.0 * count) * _UNIT * (size @ self._widest.T)
        generators = torch.cat(
            (gain @ states.generators, self._command * planes.error[:, None, :]), dim=2
        )
        box = (gain.abs() @ states.box[:, :, None])[:, :, 0] + rounding
        end = Zonotope(centre, generators, box)
        return [Piece(states, end, size @ self._second.T)]
