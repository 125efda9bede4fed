"""PPO in one file: trains a floating platform to go to a pose on `rans.Engine`, on a CPU core or a GPU.

Everything is here: the observation in the body frame, actor and critic, rollout, advantages, update, and the
judgement by `rans.evaluate`. Copy the file and change it. ``python ppo.py`` prints a row every tenth update and the
judgement of 1,024 flights at the end. The algorithm is that of Schulman et al. 2017 (arXiv:1707.06347), its
settings are those of `rans train` where both have them.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import torch
from torch import Tensor, nn

import rans

N_STEPS = 64
"""Control periods of a rollout: 12.8 s of 20 s episodes, so that most rollouts see arrivals."""
N_EPOCHS = 4
BATCHES = 4
"""Minibatches of an epoch."""
GAMMA, GAE_LAMBDA = 0.98, 0.95
CLIP_RANGE, VF_COEF, MAX_GRAD_NORM = 0.2, 0.5, 1.0
REWARD_SCALE = 0.1
"""Brings returns to about 1, so that the critic's loss has the size of the actor's."""
DESIRED_KL, LEAST_RATE, LARGEST_RATE = 0.02, 1e-4, 3e-3
"""The learning rate follows the change of the policy that an update makes, below a bound that falls (RSL-RL)."""


def body_frame(rows: Tensor) -> Tensor:
    """Observations (N, 10) of go-to-pose in the plane as (N, 7): in the body frame, each column of a size of 1.

    `rans.GoToPose` observes cos and sin of the heading, velocity, spin, a task flag, the displacement to the goal,
    and cos and sin of the turn that is left. Rotated into the body frame, one motion is one observation whatever
    the heading.
    """
    cos, sin, v_x, v_y, spin, _, d_x, d_y, cos_left, sin_left = rows.unbind(1)
    forward, left = cos * v_x + sin * v_y, cos * v_y - sin * v_x
    ahead, beside = cos * d_x + sin * d_y, cos * d_y - sin * d_x
    return torch.stack(
        (3.0 * forward, 3.0 * left, 3.0 * spin, ahead, beside, cos_left, sin_left), dim=1
    )


def network(outputs: int, gain: float, bias: float = 0.0) -> nn.Sequential:
    """Two layers of 64 with orthogonal weights; a small gain makes first outputs nearly equal to the bias."""
    layers = [nn.Linear(7, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)]
    values = (2**0.5, 0.0), (2**0.5, 0.0), (gain, bias)
    for layer, (scale, constant) in zip(layers[::2], values, strict=True):
        nn.init.orthogonal_(layer.weight, scale)
        nn.init.constant_(layer.bias, constant)
    return nn.Sequential(*layers)


class Agent(nn.Module):
    """On/off commands (N, 8) to observations (N, 10): every valve opens with a probability of its own."""

    def __init__(self) -> None:
        super().__init__()
        self.actor = network(8, 0.01, -1.4)  # valves are open 20 % of the time at first
        self.critic = network(1, 1.0)

    def distribution(self, observation: Tensor) -> torch.distributions.Bernoulli:
        """Distribution of the commands (N, 8) for observations (N, 7) in the body frame."""
        return torch.distributions.Bernoulli(logits=self.actor(observation), validate_args=False)

    def forward(self, rows: Tensor) -> Tensor:
        """Deterministic commands (N, 8) to the task's own observations (N, 10)."""
        return (self.actor(body_frame(rows)) > 0.0).float()


def rollout(
    engine: rans.Engine, agent: Agent, rows: Tensor
) -> tuple[dict[str, Tensor], Tensor, float]:
    """N_STEPS control periods of every craft: data of the update, the last observation, episodes that end there."""
    kept: dict[str, list[Tensor]] = {
        name: [] for name in ("seen", "action", "chance", "reward", "value", "end")
    }
    there = ended = 0.0
    for _ in range(N_STEPS):
        seen = body_frame(rows)
        choice = agent.distribution(seen)
        action = choice.sample()
        step = engine.step(action)
        done = step.terminated | step.truncated
        # A time limit is not part of the task: what would have followed is worth what the critic says.
        beyond = agent.critic(body_frame(step.final_observation))[:, 0]
        reward = REWARD_SCALE * step.reward + GAMMA * torch.where(step.truncated, beyond, 0.0)
        values = (
            seen,
            action,
            choice.log_prob(action).sum(1),
            reward,
            agent.critic(seen)[:, 0],
            done.float(),
        )
        for name, value in zip(kept, values, strict=True):
            kept[name].append(value.clone())
        there += float(step.at_goal.sum())
        ended += float(done.sum())
        rows = step.observation
    return (
        {name: torch.stack(values) for name, values in kept.items()},
        rows,
        there / max(ended, 1.0),
    )


def advantages(data: dict[str, Tensor], following: Tensor) -> Tensor:
    """Generalized advantage estimates (steps, N), Schulman et al. 2016 (arXiv:1506.02438)."""
    result = torch.zeros_like(data["reward"])
    carried = torch.zeros_like(following)
    for k in reversed(range(N_STEPS)):
        goes_on = 1.0 - data["end"][k]
        error = data["reward"][k] + GAMMA * goes_on * following - data["value"][k]
        carried = error + GAMMA * GAE_LAMBDA * goes_on * carried
        result[k] = carried
        following = data["value"][k]
    return result


def update(
    agent: Agent, optimizer: torch.optim.Optimizer, data: dict[str, Tensor], gained: Tensor
) -> float:
    """N_EPOCHS over a rollout; returns the divergence of the new policy from the old one."""
    flat = {name: value.flatten(0, 1) for name, value in data.items()}
    flat["advantage"] = (gained - gained.mean()).flatten() / (gained.std() + 1e-8)
    flat["target"] = (gained + data["value"]).flatten()
    count = len(flat["target"])
    divergences = []
    for _ in range(N_EPOCHS):
        for rows in torch.randperm(count, device=gained.device).chunk(BATCHES):
            batch = {name: value[rows] for name, value in flat.items()}
            change = (
                agent.distribution(batch["seen"]).log_prob(batch["action"]).sum(1) - batch["chance"]
            )
            ratio = change.exp()
            clipped = ratio.clamp(1.0 - CLIP_RANGE, 1.0 + CLIP_RANGE)
            surrogate = torch.minimum(
                ratio * batch["advantage"], clipped * batch["advantage"]
            ).mean()
            missed = (agent.critic(batch["seen"])[:, 0] - batch["target"]).square().mean()
            optimizer.zero_grad()
            (VF_COEF * missed - surrogate).backward()
            nn.utils.clip_grad_norm_(agent.parameters(), MAX_GRAD_NORM)
            optimizer.step()
            divergences.append(
                float((ratio.detach() - 1.0 - change.detach()).mean())
            )  # of Schulman's estimator k3
    return sum(divergences) / len(divergences)


def train(steps: int, n_envs: int, device: str) -> Agent:
    """An agent after this number of control periods, of all environments together."""
    engine = rans.Engine("floating-platform", "go-to-pose", n_envs, device=device)
    engine.stagger()  # clocks differ, so that not all episodes end together
    agent = Agent().to(device)
    rate = 1e-3
    optimizer = torch.optim.Adam(agent.parameters(), lr=rate, eps=1e-5)
    begun = time.perf_counter()
    rows = engine.observe()
    updates = max(1, steps // (N_STEPS * n_envs))
    for number in range(1, updates + 1):
        with torch.no_grad():
            data, rows, success = rollout(engine, agent, rows)
            gained = advantages(data, agent.critic(body_frame(rows))[:, 0])
        divergence = update(agent, optimizer, data, gained)
        # The next learning rate: larger after a small change of the policy, smaller after a large one.
        if divergence > 2.0 * DESIRED_KL:
            rate /= 1.5
        elif divergence < 0.5 * DESIRED_KL:
            rate *= 1.5
        falling = 2.0 * LARGEST_RATE * (1.0 - number / updates)  # over the second half
        rate = max(min(rate, LARGEST_RATE, falling), LEAST_RATE)
        optimizer.param_groups[0]["lr"] = rate
        if number % 10 == 0:
            print(
                f"{number * N_STEPS * n_envs:9,} steps, {time.perf_counter() - begun:5.1f} s: "
                f"{success:6.1%} of episodes end at the goal, learning rate {rate:.1e}"
            )
    return agent


def main() -> None:
    """Train, judge by 1,024 flights, and write the weights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=3_000_000)
    parser.add_argument("--envs", type=int, default=256)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--save", type=Path, metavar="FILE", help="weights of the agent")
    arguments = parser.parse_args()
    torch.manual_seed(arguments.seed)
    agent = train(arguments.steps, arguments.envs, arguments.device).cpu()
    print(rans.evaluate(rans.load_agent(agent, "go-to-pose"), episodes=1024))
    if arguments.save is not None:
        torch.save(agent.state_dict(), arguments.save)


if __name__ == "__main__":
    main()
