"""Vector functions as machine code, against NumPy in double precision."""

import numpy as np
import pytest
from rans_machine_code.llvm import LANES, LONG, POINTER, compiled

X = np.concatenate((np.linspace(-12, 12, 4096), np.geomspace(1e-30, 1e-3, 2048))).astype(np.float32)
ORACLES = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "elu": lambda x: np.where(x > 0, x, np.expm1(x)),
    "": lambda x: x,
}


@pytest.mark.parametrize("name", ORACLES)
def test_activations_are_numpys(name):
    out = np.empty_like(X)

    def write(code, given, to):
        def vector(number, _):
            place = code.mul(number, LONG(LANES))
            code.write(code.activation(name, code.read(given, place)), to, place)
            return []

        code.repeat(len(X) // LANES, [], vector)

    compiled((POINTER, POINTER), write)[0](X.ctypes.data, out.ctypes.data)
    # Eigen's rational function is good to four units in the last place; elu divides by its difference to one.
    np.testing.assert_allclose(out, ORACLES[name](X.astype(np.float64)), rtol=8 * 2.0**-24)
