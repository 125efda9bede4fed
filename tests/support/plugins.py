"""Plug-ins of ``examples/plugins``, registered in this process as an installed package would register them."""

from __future__ import annotations

from typing import Any, cast

from rans_attention.backbone import EffectorAttention
from rans_gradient.learner import Gradient
from rans_imitation.learner import Imitation
from rans_lookahead.lookahead import looking_ahead
from rans_space_certificates.bounder import spatial_bounder
from rans_value.learner import Value

from rans.evaluation.fly.controllers import WRAPPERS
from rans.fast.learn.learners import LEARNERS
from rans.optimal.certificate.certificate import BOUNDERS
from rans.policy.backbone_registry import BACKBONES


def register() -> None:
    """Register learners, backbones, bounders and wrappers unless another module of tests has."""
    for name, kind in (
        ("gradient", Gradient),
        ("imitation", Imitation),
        ("value", Value),
    ):
        if name not in LEARNERS:
            LEARNERS.register(name)(kind)
    if "attention" not in BACKBONES:
        BACKBONES.register("attention")(cast("Any", EffectorAttention))
    if "lookahead" not in WRAPPERS:
        WRAPPERS.register("lookahead")(looking_ahead)
    if "space" not in BOUNDERS:
        BOUNDERS.register("space")(spatial_bounder)
