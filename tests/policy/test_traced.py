"""Every kind of policy commands the same by every executor that takes it; the others refuse it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from rans_any_craft.networks import effects

from rans.fast.flights import Flights
from rans.model.actuators import Throttle
from rans.model.spacecraft_file import load_spacecraft
from rans.policy.network import Network
from rans.policy.scalars import fields
from rans.policy.traced import parameters, policy_program
from tests.support.engines import FLYER, PLATFORM
from tests.support.filter_flights import bank
from tests.support.kernel_flights import BRIEF, WIDE, policy, setup

THROTTLED = replace(PLATFORM, actuators=Throttle())
PLATFORM_SHARED = load_spacecraft("floating-platform-shared")
# Of eight there are more patterns than machine code compares.
SUPPLIED = replace(PLATFORM_SHARED, thrusters=PLATFORM_SHARED.thrusters[:7])
BANK = bank(PLATFORM, WIDE, (0.1, 1.0), period=BRIEF.control_period)
POLICIES: dict[str, tuple[Any, dict[str, Any]]] = {
    "on/off": (PLATFORM, {}),
    "space": (FLYER, {}),
    "one side": (FLYER, {"sided": False}),
    "saturated columns": (PLATFORM, {"zoom": 8.0}),
    "elu": (PLATFORM, {"activation": "elu"}),
    "relu": (PLATFORM, {"activation": "relu"}),
    "silu": (PLATFORM, {"activation": "silu"}),
    "throttles": (THROTTLED, {}),
    "gated throttles": (THROTTLED, {"head": "gated"}),
    "gated throttles, one side": (THROTTLED, {"head": "gated", "sided": False}),
    "history": (PLATFORM, {"history": 2}),
    "averages of commands": (PLATFORM, {"averages": (0.5, 0.9), "commands_only": True}),
    "gated throttles, history": (THROTTLED, {"head": "gated", "history": 2}),
    "filters": (PLATFORM, {"filters": BANK, "zoom": 4.0}),
    "patterns that share a supply": (
        SUPPLIED,
        {"sided": False, "backbone": "allocated", "tokens": effects(SUPPLIED, 0.2)},
    ),
}
STEPS = 4
COUNT = 200
each_policy = pytest.mark.parametrize("kind", POLICIES)


@cache
def known(kind: str) -> tuple[Network, np.ndarray, np.ndarray]:
    """A policy, and in double precision its answers (STEPS, COUNT, n) to observations.

    Only those are kept in which no choice is close, which rounding could turn.
    """
    craft, settings = POLICIES[kind]
    network = policy(craft, **settings)
    width = network.architecture.layout.width
    rows = torch.randn(STEPS, COUNT, width, generator=torch.Generator().manual_seed(3))
    exact = Network(network.architecture, {name: x.double() for name, x in network.tensors.items()})
    memory = exact.initial_state(COUNT)
    commands = []
    clear = torch.ones(COUNT, dtype=torch.bool)
    with torch.no_grad():
        for one in rows.double():
            output, columns = exact.forward(one, memory)
            margin = output.policy.margin()
            if not network.architecture.last.spread or network.architecture.head == "gated":
                clear &= (margin > 1e-3).all(dim=1)
            commands.append(output.policy.mode())
            memory = exact.next_state(columns, memory, commands[-1])
    assert clear.sum() > COUNT // 2
    return network, rows[:, clear].numpy(), torch.stack(commands)[:, clear].numpy()


def agree(found: Any, expected: np.ndarray) -> None:
    """Commands of float32 sums of about a hundred numbers of order one."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4)


@each_policy
def test_policies_command_something(kind):
    _, _, commands = known(kind)
    assert 0.05 < commands.mean() < 0.95
    if "gated" in kind:
        assert 0.05 < (commands == 0).mean() < 0.95


@each_policy
def test_the_traced_program_on_fields(kind):
    """The program that all other executors are printed from, run by NumPy."""
    network, rows, expected = known(kind)
    given = network.architecture
    program = policy_program(given)
    tables = parameters(network)

    def dense(step, row):
        weight, bias = (tables[name] for name in step.inputs[1:])
        found = torch.from_numpy(weight @ np.stack(row) + bias[:, None])
        name = step.attributes["activation"]
        return list(given.activation_module()(found).numpy() if name else found.numpy())

    own = {name: tables[name] for name in ("mean", "scale", "zoom") if name in program.parameters}
    memory = np.zeros((given.memory, rows.shape[1]))
    found = []
    for one in rows:
        asked = ["command", "memory_out"] if given.memory else ["command"]
        answer = fields(program, {"observation": one.T, "memory": memory} | own, asked, dense)
        found.append(np.stack(answer["command"], axis=1))
        memory = np.stack(answer["memory_out"]) if given.memory else memory
    agree(np.stack(found), expected)


@each_policy
def test_flights_as_machine_code(kind):
    """What the processor's own code flies is what torch and NumPy fly; what it has no code for, they fly."""
    network, _, _ = known(kind)
    craft, settings = POLICIES[kind]
    given = setup(craft, settings.get("task", WIDE))
    ours, theirs = (Flights(network, given, generated=generated) for generated in (True, False))
    found, expected = (one.fly(1000, COUNT, 2**40 + 5) for one in (ours, theirs))
    assert found.ways == {"CPU, float32"}
    # Sums of float32 in another order: of 200 flights two may be judged otherwise.
    assert abs(found.unsolved - expected.unsolved) <= 2
    for name, sums in expected.sums.items():
        np.testing.assert_allclose(found.sums[name].mean, sums.mean, rtol=5e-3, err_msg=name)
