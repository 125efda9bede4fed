"""Fuel of commands."""

import numpy as np
import pytest
from rans_bounds.flight import fuel

from tests.support.tiny_lattice import lopsided


def test_fuel_by_hand():
    commands = np.zeros((3, 5))
    commands[0, 1] = commands[2, 4] = 1.0  # 1.5 N and 0.8 N, 0.2 s each
    assert fuel(lopsided(), commands, 0.2) == pytest.approx(0.46)
