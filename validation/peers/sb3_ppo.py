"""Plain Stable-Baselines3 PPO on our environment, with the task, layers and settings of our own trainer.

Its policy is its own, a distribution object a thruster, and knows nothing of the spacecraft's symmetry.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnvWrapper
from stopwatch import options, say, steps_per_second

from rans.fast.engine import Engine
from rans.fast.envs.sb3 import SB3VecEnv
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.member import SOLVED_IN_A_ROW, architecture_of
from rans.fast.learn.recipes import preset
from rans.fast.learn.selection import Selection
from rans.fast.policy import network_of, policy_kwargs
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.tasks import GoToPose

_LIMIT = 300.0
"""Training not solved after so many seconds is given up."""
_REPORT_INTERVAL = 16
_SOLVED_SHARE = 0.995
"""As `rans.fast.learn.config.TrainConfig` has them: iterations between reports, and what they must find."""
_CRAFT = load_spacecraft("floating-platform")
_TASK = GoToPose()


class _Scaled(VecEnvWrapper):
    """Rewards times a factor, which our trainer applies itself."""

    def __init__(self, env: SB3VecEnv, factor: float) -> None:
        super().__init__(env)
        self._factor = factor

    def reset(self) -> Any:
        return self.venv.reset()

    def step_wait(self) -> Any:
        observation, reward, done, infos = self.venv.step_wait()
        return observation, reward * self._factor, done, infos


def main() -> None:
    """Measure and print."""
    given = options()
    torch.set_num_threads(1)  # as our trainer does
    settings = replace(preset("go-to-pose", _CRAFT.dimension, given.device), symmetric=False)
    rollout = settings.n_envs * settings.n_steps
    model = _model(settings, given.device)
    rate = steps_per_second(
        lambda: model.learn(rollout, reset_num_timesteps=False), rollout, given.seconds
    )
    success = {} if given.quick else _train(settings, given.device)
    layers = "x".join(map(str, settings.layers))
    say(
        "stable-baselines3",
        f"go-to-pose, {_CRAFT.name}, network {layers}",
        "learn() on rans.SB3VecEnv",
        settings.n_envs,
        given.device,
        same_task=True,
        trained_steps_per_s=rate,
        **success,
    )


def _model(settings: PPOSettings, device: str) -> PPO:
    engine = Engine(_CRAFT, _TASK, settings.n_envs, device=device)
    env = _Scaled(SB3VecEnv(engine), settings.reward_scale)
    names = (
        "n_steps",
        "batch_size",
        "n_epochs",
        "learning_rate",
        "gamma",
        "gae_lambda",
        "clip_range",
        "ent_coef",
        "vf_coef",
        "max_grad_norm",
    )
    return PPO(
        ActorCriticPolicy,
        env,
        policy_kwargs=policy_kwargs(architecture_of(engine, settings)),
        seed=0,
        device=device,
        **{name: getattr(settings, name) for name in names},
    )


def _train(settings: PPOSettings, device: str) -> dict[str, float | bool]:
    """Seconds of training until two reports in a row find the task solved, judged as our trainer judges."""
    model = _model(settings, device)
    seconds = 0.0
    in_a_row = 0
    selection = Selection(network_of(model.policy), _CRAFT, [_TASK], Timing(), torch.device(device))
    while in_a_row < SOLVED_IN_A_ROW and seconds < _LIMIT:
        begun = time.perf_counter()
        model.learn(
            _REPORT_INTERVAL * settings.n_envs * settings.n_steps, reset_num_timesteps=False
        )
        seconds += time.perf_counter() - begun
        in_a_row = in_a_row + 1 if selection.judge()[0]["success"] >= _SOLVED_SHARE else 0
    return {
        "solved": in_a_row >= SOLVED_IN_A_ROW,
        "seconds_to_success": seconds,
        "steps_to_success": model.num_timesteps,
    }


if __name__ == "__main__":
    main()
