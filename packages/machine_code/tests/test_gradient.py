"""Gradients and answers as machine code, against torch's."""

import pytest
import torch
from rans_machine_code.gradient import CpuGradient
from rans_machine_code.matmul import WIDTH

from rans.base.errors import RansWarning
from rans.fast.learn.ppo import PPOLearner, losses
from rans.fast.learn.rollout import minibatches
from rans.model.fields import absolute, within
from rans.policy.heads import OnOff
from tests.support.training import MACHINE_CODE_CASES, collected, tiny_learner


class OwnLoss(PPOLearner):
    """A loss as a researcher may change it: a dear value, clipped, and a bonus for entropy."""

    def loss(self, sample):
        usual = super().loss(sample)
        near = within(sample.target - sample.value, -0.1, 0.1)
        dear = 1000.0 * usual.value_loss + 3.0 * near * near - 0.3 * sample.entropy
        return usual._replace(loss=usual.loss + dear / (1.0 + absolute(sample.advantage)))


@MACHINE_CODE_CASES
@pytest.mark.parametrize("kind", [PPOLearner, OwnLoss])
def test_gradients_are_autograds(craft, settings, kind):
    learner, batch = collected(craft, **settings)
    learner.__class__ = kind
    learner.backend = machine = CpuGradient(learner.network, learner.adam, learner.loss)
    (part,) = minibatches(batch, 1)
    exact = losses(learner.network, part, learner.loss)
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


def test_a_head_that_has_changed_is_left_to_autograd_and_says_so(monkeypatch):
    usual = OnOff.log_prob
    monkeypatch.setattr(OnOff, "log_prob", lambda self, action: 1.01 * usual(self, action))
    with pytest.warns(RansWarning, match="head has changed"):
        assert tiny_learner().backend is None


def test_a_loss_that_is_no_arithmetic_is_left_to_autograd_and_says_so():
    learner = tiny_learner()
    learner.loss = lambda sample: PPOLearner.loss(learner, sample)._replace(  # type: ignore[method-assign]
        loss=sample.value.square()
    )
    learner.collect()
    with pytest.warns(RansWarning, match="left to autograd.*square"):
        learner.update()
    assert learner.description == ""


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
