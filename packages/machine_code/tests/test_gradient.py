"""Gradients and answers as machine code, against torch's."""

import pytest
import torch
from rans_machine_code.gradient import CpuGradient
from rans_machine_code.matmul import WIDTH

from rans.fast.learn.ppo import losses
from rans.fast.learn.rollout import minibatches
from tests.support.training import MACHINE_CODE_CASES, collected, tiny_learner


@MACHINE_CODE_CASES
def test_gradients_are_autograds(craft, settings):
    learner, batch = collected(craft, **settings)
    learner.backend = machine = CpuGradient(learner.network, learner.adam, learner.settings)
    (part,) = minibatches(batch, 1)
    exact = losses(learner.network, part, learner.settings)
    network = learner.network
    gradients = torch.autograd.grad(exact.loss, [network.tensors[name] for name in network.learnt])
    (part,) = minibatches(learner.batch(), 1)
    learner.adam.gradient.fill_(float("nan"))
    found = machine(part)
    # 160 float32 summands in another order.
    torch.testing.assert_close(found, tuple(x.detach() for x in exact), rtol=1e-5, atol=1e-6)
    for name, gradient in zip(network.learnt, gradients, strict=True):
        start = network.tensors[name].storage_offset()
        own = learner.adam.gradient[start : start + gradient.numel()].view(gradient.shape)
        assert (own - gradient).norm() <= 1e-5 * gradient.norm(), name


@pytest.mark.parametrize(
    "settings",
    [
        {"privileged_critic": True},
        {"continuous": True},
        {"n_envs": 4, "batch_size": WIDTH // 2},
    ],
)
def test_what_is_left_to_autograd(settings):
    assert tiny_learner(**settings).backend is None
