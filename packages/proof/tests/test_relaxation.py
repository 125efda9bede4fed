"""Bounds of activations and networks against sampled inputs."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from rans_proof.network import apply
from rans_proof.relaxation import TorchLayer, Zonotope, enclose, parallel_lines

from tests.support.small_networks import layers


@given(
    st.floats(-30.0, 30.0),
    st.one_of(st.just(0.0), st.floats(1e-12, 40.0)),
    st.sampled_from(["tanh", "sigmoid", "relu"]),
)
@settings(max_examples=200, deadline=None)
def test_an_activation_lies_between_its_lines(low: float, width: float, kind: str) -> None:
    ends = (
        torch.tensor([low], dtype=torch.float64),
        torch.tensor([low + width], dtype=torch.float64),
    )
    slope, offset, error = (float(x) for x in parallel_lines(*ends, kind))
    z = np.linspace(low, low + width, 400)
    bends = {
        "tanh": np.tanh,
        "sigmoid": lambda z: 1.0 / (1.0 + np.exp(-z)),
        "relu": lambda z: z * (z > 0),
    }
    y = bends[kind](z)
    # The test's own values have rounding errors of a few units in the last place.
    assert (np.abs(y - slope * z - offset) <= error + 4e-16 * (1.0 + np.abs(z).max())).all()
    assert error <= (1.0 if kind != "relu" else 0.125 * width + 1e-9)


@pytest.mark.parametrize("activation", ["tanh", "sigmoid", "relu"])
@pytest.mark.parametrize("sizes", [(3, 2), (3, 8, 2), (3, 8, 9, 2), (3, 6, 7, 8, 2)])
def test_a_network_lies_between_its_planes(activation: str, sizes: tuple[int, ...]) -> None:
    """Random points of random zonotopes, extreme ones among them."""
    network = layers(sizes, 1, activation, 2.0)
    random = np.random.default_rng(2)
    centre = random.normal(size=(5, 3))
    generators = 0.2 * random.normal(size=(5, 3, 4))
    box = 0.1 * random.random((5, 3))
    tensors = [
        TorchLayer(torch.tensor(one.weight), torch.tensor(one.bias), one.activation)
        for one in network
    ]
    planes = enclose(tensors, Zonotope(*map(torch.tensor, (centre, generators, box))))
    for k in range(5):
        s = random.uniform(-1, 1, (2000, 4))
        t = random.uniform(-1, 1, (2000, 3))
        s[::2] = np.sign(s[::2])
        t[::2] = np.sign(t[::2])
        x = centre[k] + s @ generators[k].T + t * box[k]
        linear = x @ planes.gain[k].numpy().T + planes.offset[k].numpy()
        assert (np.abs(apply(network, x) - linear) <= planes.error[k].numpy()).all()
    assert float(planes.error.max()) < 2.0
