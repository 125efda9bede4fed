"""Plug-ins of ``examples/plugins``, registered in this process as an installed package would register them."""

from __future__ import annotations

from rans_bounds.certificate import BOUNDERS
from rans_space_certificates.bounder import spatial_bounder


def register() -> None:
    """Register bounders unless another module of tests has."""
    if "space" not in BOUNDERS:
        BOUNDERS.register("space")(spatial_bounder)
