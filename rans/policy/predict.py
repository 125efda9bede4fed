"""Actions of an agent for arrays of observations, as Stable-Baselines3 has them."""

from __future__ import annotations

import numpy as np
import torch

from rans.base.errors import ConfigError
from rans.base.inputs import array
from rans.policy.network import Network


@torch.no_grad()
def predict(
    network: Network,
    observation: np.ndarray,
    state: tuple[np.ndarray, ...] | None = None,
    episode_start: np.ndarray | None = None,
    deterministic: bool = True,
) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
    """Commands (N, thrusters), integers for on/off thrusters, and its memory afterwards.

    Args:
        network: of the agent.
        observation: (N, width) or (width,).
        state: memory ((N, m),) after the previous step; None: all episodes begin.
        episode_start: (N,) bool, true where an episode begins; None: nowhere.
        deterministic: whether the action is the mode of the policy rather than a sample.

    Raises:
        ConfigError: the width of the observations differs from that in training, or the memory is of another shape.
    """
    architecture = network.architecture
    architecture.check_width("the policy", observation)
    device = next(iter(network.tensors.values())).device
    rows = torch.as_tensor(np.asarray(observation), device=device).reshape(
        -1, architecture.layout.width
    )
    # Memory: continued, and cleared where an episode starts.
    memory = network.initial_state(len(rows))
    if memory is not None and state is not None:
        shape = tuple(memory.shape)
        given = array("the memory", state[0] if isinstance(state, tuple | list) else state)
        if given.shape != shape or given.dtype.kind != "f":
            raise ConfigError(
                f"the memory must be what the step before gave, numbers of shape {shape}, got"
                f" {given.shape} of {given.dtype}."
            )
        memory = torch.as_tensor(given).to(memory)
        if episode_start is not None:
            memory = memory.where(~torch.as_tensor(episode_start).to(memory.device)[:, None], 0.0)
    # Command, and the memory that it leaves.
    output, columns = network.forward(rows, memory)
    command = output.policy.mode()
    if not deterministic:
        command = output.policy.command(output.policy.sample(torch.rand_like(command)))
    memory = network.next_state(columns, memory, command)
    # Back to arrays in the shape of the observation.
    action = command.cpu().numpy().astype(np.float32 if architecture.continuous else np.int64)
    action = action.reshape(*np.shape(observation)[:-1], action.shape[1])
    return action, None if memory is None else (memory.cpu().numpy(),)
