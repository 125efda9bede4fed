"""CleanRL's PPO (ppo.py, MIT licence, Huang et al., JMLR 23, 2022) on thousands of spacecraft, without glue.

Its details: orthogonal weights, advantages normalised per minibatch, clipped losses, annealed step size. What
is ours: tensors throughout, and a Bernoulli choice for each valve.
"""

from __future__ import annotations

import torch
from shared import N_ENVS, N_STEPS, Agent, Spacecraft, main
from torch import Tensor, nn
from torch.distributions import Bernoulli

EPOCHS = 4
MINIBATCHES = 4
GAMMA = 0.98
LAMBDA = 0.95
CLIP = 0.2
RATE = 1e-3


def network(inputs: int, outputs: int, gain: float) -> nn.Sequential:
    """Two layers of 64."""
    layers = [nn.Linear(inputs, 64), nn.Linear(64, 64), nn.Linear(64, outputs)]
    for layer, scale in zip(layers, (2**0.5, 2**0.5, gain), strict=True):
        nn.init.orthogonal_(layer.weight, scale)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(layers[0], nn.Tanh(), layers[1], nn.Tanh(), layers[2])


def train(steps: int) -> Agent:
    """An agent that was trained for so many steps."""
    envs = Spacecraft()
    width = envs.single_observation_space.shape[0]
    valves = envs.single_action_space.shape[0]
    actor = network(width, valves, 0.01)
    critic = network(width, 1, 1.0)
    weights = [*actor.parameters(), *critic.parameters()]
    adam = torch.optim.Adam(weights, RATE, eps=1e-5)
    updates = max(1, steps // (N_ENVS * N_STEPS))
    seen, _ = envs.reset(seed=0)
    for update in range(updates):
        adam.param_groups[0]["lr"] = RATE * (1 - update / updates)
        rows: list[tuple[Tensor, ...]] = []
        with torch.no_grad():
            for _ in range(N_STEPS):
                policy = Bernoulli(logits=actor(seen))
                value = critic(seen)[:, 0]
                action = policy.sample()
                after, reward, terminated, truncated, info = envs.step(action)
                # Time that runs out is no end of the task: what would have followed counts.
                rest = critic(info["final_obs"])[:, 0] * truncated
                log_prob = policy.log_prob(action).sum(1)
                over = terminated | truncated
                rows.append((seen, action, log_prob, value, reward + GAMMA * rest, over))
                seen = after
            follows = critic(seen)[:, 0]
            advantages = []
            advantage = torch.zeros(N_ENVS)
            for _, _, _, value, reward, over in reversed(rows):
                error = reward + GAMMA * follows * ~over - value
                advantage = error + GAMMA * LAMBDA * ~over * advantage
                advantages.insert(0, advantage)
                follows = value
        flat = [torch.cat(column) for column in zip(*rows, strict=True)]
        learn(actor, critic, adam, flat, torch.cat(advantages))
    return Agent(lambda rows: actor(rows) > 0, actor)


def learn(
    actor: nn.Module,
    critic: nn.Module,
    adam: torch.optim.Optimizer,
    rows: list[Tensor],
    advantages: Tensor,
) -> None:
    """Some passes over a rollout in minibatches."""
    seen, action, before, value = rows[:4]
    returns = advantages + value
    weights = adam.param_groups[0]["params"]
    for _ in range(EPOCHS):
        for some in torch.randperm(len(seen)).chunk(MINIBATCHES):
            policy = Bernoulli(logits=actor(seen[some]))
            ratio = (policy.log_prob(action[some]).sum(1) - before[some]).exp()
            gain = advantages[some]
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            surrogate = torch.min(gain * ratio, gain * ratio.clamp(1 - CLIP, 1 + CLIP)).mean()
            loss = 0.5 * (critic(seen[some])[:, 0] - returns[some]).square().mean() - surrogate
            adam.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(weights, 0.5)
            adam.step()


if __name__ == "__main__":
    main(train)
