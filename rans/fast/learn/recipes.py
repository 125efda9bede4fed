"""Hyper-parameters known to solve a task (decision 005), and those of the agents that come with RANS."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import torch

from rans.errors import ConfigError, brief, meant
from rans.fast.learn.config import Failures, PPOSettings, TrainConfig
from rans.fast.learn.curriculum import Ramp
from rans.fast.learn.troubles import failing_in_other_bodies, robust, robust_poses
from rans.model.conditions import Conditions
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.tasks import (
    TASKS,
    GoToPose,
    GoToPosition,
    TrackTwist,
    TrackVelocity,
    TrackVelocityHeading,
)

_CPU = PPOSettings()
_CPU_SPACE = PPOSettings(n_envs=256, batch_size=4096, layers=(128, 128))
_GPU = PPOSettings(n_envs=256, n_steps=32, batch_size=2048, layers=(128, 128))
_GPU_SPACE = PPOSettings(n_envs=2048, n_steps=32, batch_size=16_384, layers=(256, 256))
_BY_BODY = {(2, "cpu"): _CPU, (3, "cpu"): _CPU_SPACE, (2, "cuda"): _GPU, (3, "cuda"): _GPU_SPACE}

_LONGER = 16  # on a GPU
_MANY = {("multi-task", 2, "cuda"): replace(_GPU, n_envs=512, n_steps=64, batch_size=8192)}
"""Many tasks at once need more flight in an update than one."""


@dataclass(frozen=True)
class Recipe:
    """What differs from agent to agent; the rest is as in every training."""

    task: str
    spacecraft: str
    settings: dict[str, Any]
    """Of the task, where they are not its defaults."""
    ppo: PPOSettings = field(default_factory=PPOSettings)
    total_timesteps: int = 10_000_000
    curriculum: tuple[Ramp, ...] = ()
    conditions: Callable[[], Conditions] = Conditions
    """What episodes do not promise, made when it is asked for."""
    large: dict[str, Any] = field(default_factory=dict)
    """Of the hyper-parameters, on a GPU, where they are not `_LARGE`."""
    large_timesteps: int | None = None
    """On a GPU, if not `_LONGER` times those of a CPU core."""
    timing: Timing = field(default_factory=Timing)
    """Of the training."""
    episode_steps: int | None = None
    """Of the training, if not the timing's."""
    failures: Failures = field(default_factory=Failures)
    """On a GPU, where very many flights take no time."""


_PLANE = PPOSettings(
    n_envs=256, n_steps=64, batch_size=4096, gamma=0.99, max_learning_rate=3e-3, anneal=0.7
)
"""Twice a preset's batch and a step size that falls to zero: minutes on one core, closer in the end."""
_SHARP = replace(_PLANE, zoom=16.0)
"""For goals that are held to millimetres."""
_STILL = replace(_SHARP, initial_duty=0.12)
"""With shut valves."""
_SOON = replace(_SHARP, gamma=0.98, initial_duty=0.2)
"""For what is worth most to those who are there, at rest."""
_ADAPTIVE = replace(
    _SHARP,
    gamma=0.98,
    initial_duty=0.2,
    memory="history",
    history=8,
    averages=(0.5, 0.8, 0.9, 0.95),
)
"""For a world that is not as designed, which only what has happened tells, and noise hides."""
_INFORMED = replace(_ADAPTIVE, privileged_critic=True)
"""The critic is told what the policy has to find out, so that luck with the world is none of its merit."""
_FILTERED: dict[str, Any] = {
    "memory": "commands",
    "history": 2,
    "averages": (),
    "filters": (0.003, 0.1),
    "filtered_steady": (25.0, 25.0),
    "filtered_response": (2.0, 2.0),
    "filtered_gate": 5.0,
}
"""Kalman filters and the last commands tell more of it in a quarter of the numbers (decision 024)."""
_TRUSTING = {
    "filters": (0.001, 0.1),
    "filtered_steady": (0.0, 25.0),
    "filtered_response": (0.0, 3.0),
}
"""One of them trusts the craft as designed, which hides noise best, and one finds out."""
_LOOSE = {"fine_weight": 1.0, "rest_position": 0.02, "rest_attitude": 0.02}
"""For goals that are held to centimetres, however the world is."""
_WIDE = (128, 128)  # layers for space
_COARSE = Timing(substeps=1)
"""For troubles that would take four, and a program of 69,000 operations: agents learn in motion that is a
millimetre off as well, and are judged in motion that is not."""
_HOLD = {"fine_weight": 1.0, "rest_position": 0.006}
_LARGE: dict[str, Any] = {"n_envs": 4096, "n_steps": 32, "batch_size": 32768, "layers": (256, 256)}
_ADAPTIVE_LARGE = {"n_envs": 16384, "n_steps": 16, "n_epochs": 2, "matmul": "bf16"}
_SOON_LARGE = {**_ADAPTIVE_LARGE, "layers": (512, 256)}
_WIDEST = {**_ADAPTIVE_LARGE, "layers": (512, 512)}
_PLATFORM = "floating-platform"
_SHARED = "floating-platform-shared"
_FLYER = "free-flyer"
_FLYER_SHARED = "free-flyer-shared"
_VELOCITY = {"fine_scale": 0.01, "thrust_weight": 0.05}
_THERE = (
    Ramp("arrived_still_weight", 0.1, 37_500_000, 15_625_000, "geometric"),
    Ramp("verge_weight", 1.0, 37_500_000, 15_625_000, "geometric"),
)
"""Raised slowly: from the beginning they teach to brake slowly (decision 018)."""
_TRACKED = {"fine_scale": 0.02, "thrust_weight": 0.08, "within_weight": 6.0}
_STEADY: dict[str, dict[str, Any]] = {
    "go-to-position": {
        "fine_weight": 1.0,
        "rest_position": 0.02,
        "rest_spin": 0.05,
        "thrust_weight": 0.12,
    },
    "track-velocity": _TRACKED,
    "track-velocity-heading": {**_TRACKED, "within_weight": 3.0},
}
"""Of the other tasks, however the world is."""
_STEADY_STEPS = {
    "go-to-position": 350_000_000,
    "track-velocity": 1_600_000_000,
    "track-velocity-heading": 600_000_000,
}
"""In the plane, on a GPU."""
_TRACKED_STEPS = {"track-velocity": 1_800_000_000, "track-velocity-heading": 2_000_000_000}
"""In space, on a GPU."""
_PRICED_LATE = Ramp("thrust_weight", 0.02, 5_000_000, 625_000, "geometric")
_STAYED = Ramp("verge_weight", 0.5, 31_250_000, 12_500_000, "geometric")
"""Who has learnt to arrive is asked to stay."""
_STAYED_LATER = Ramp("verge_weight", 0.5, 37_500_000, 25_000_000, "geometric")
"""In space that is learnt later."""
_ARRIVED = {
    "arrived_weight": 6.0,
    "arrived_fine_weight": 2.0,
    "arrived_thrust_weight": 0.5,
    "arrived_squarings": 3,
}
"""For who is there, at rest, however the world is."""
_TWIST = {**_VELOCITY, "fine_spin_weight": 1.0, "fine_spin_scale": 0.01}
_SHUT_FIRST = tuple(
    Ramp(weight, start, 10_000_000, 1_500_000, "geometric")
    for weight, start in (("fine_weight", 0.05), ("fine_spin_weight", 0.05), ("thrust_weight", 0.1))
)
"""For shared thrust: who learns to be exact first keeps cancelling nozzles open, of which one more or less is
a small push, and to shut one of them alone is worth nothing."""
_EVERY = {
    "go_to_position": GoToPosition(
        fine_weight=0.5, rest_position=0.007, rest_spin=0.03, thrust_weight=0.05
    ),
    "go_to_pose": GoToPose(
        fine_weight=1.0, rest_position=0.006, rest_attitude=0.035, thrust_weight=0.1
    ),
    "track_velocity": TrackVelocity(fine_scale=0.02, thrust_weight=0.05),
    "track_twist": TrackTwist(
        spin_scale=0.15, fine_weight=1.0, fine_scale=0.03, thrust_weight=0.03
    ),
    "track_velocity_heading": TrackVelocityHeading(fine_scale=0.02),
}
"""Of the tasks that one agent flies."""
_WITHIN = {"track_velocity": 1.0, "track_twist": 3.0, "track_velocity_heading": 1.0}
_EVERY_WITHIN = _EVERY | {
    name: replace(_EVERY[name], within_weight=x) for name, x in _WITHIN.items()
}

RECIPES: dict[str, Recipe] = {
    "go-to-pose-2d": Recipe(
        "go-to-pose",
        _PLATFORM,
        {**_HOLD, "rest_attitude": 0.035, "thrust_weight": 0.13},
        _SHARP,
        25_000_000,
        (Ramp("thrust_weight", 0.05, 15_000_000, shape="geometric"),),
    ),
    "go-to-pose-2d-fast": Recipe(
        "go-to-pose",
        _PLATFORM,
        {
            "spawn_distance": (1.5, 4.5),
            "arrived_weight": 60.0,
            "arrived_fine_weight": 14.0,
            "arrived_still_weight": 10.0,
            "arrived_thrust_weight": 8.0,
            "arrived_squarings": 5,
            "verge_weight": 200.0,
            "rest_position": 0.004,
            "rest_attitude": 0.02,
            "thrust_weight": 1.5,
        },
        replace(_SOON, n_steps=32, batch_size=2048, reward_scale=0.008),
        80_000_000,
        (Ramp("thrust_weight", 0.15, 15_000_000, shape="geometric"), *_THERE),
        large=_WIDEST,
        large_timesteps=3_400_000_000,
        episode_steps=60,
    ),
    "go-to-pose-2d-thrifty": Recipe(
        "go-to-pose",
        _PLATFORM,
        {
            "spawn_distance": (2.0, 4.3),
            "fine_weight": 2.5,
            "fine_position_scale": 0.015,
            "fine_attitude_scale": 0.015,
            "misaligned_weight": 20.0,
            "rest_position": 0.04,
            "rest_attitude": 0.07,
            "thrust_weight": 9.0,
            "spin_weight": 3.0,
        },
        replace(_STILL, gamma=0.995, reward_scale=0.03),
        75_000_000,
        tuple(
            Ramp(price, start, 52_500_000, shape="geometric")
            for price, start in (
                ("thrust_weight", 0.1),
                ("spin_weight", 0.1),
                ("misaligned_weight", 0.3),
            )
        ),
        large=_SOON_LARGE,
        large_timesteps=3_500_000_000,
    ),
    "go-to-pose-2d-knob": Recipe(
        "go-to-pose-priced",
        _PLATFORM,
        {
            "spawn_distance": (1.5, 4.5),
            "arrived_weight": 40.0,
            "arrived_fine_weight": 8.0,
            "arrived_still_weight": 8.0,
            "arrived_thrust_weight": 2.0,
            "arrived_squarings": 5,
            "verge_weight": 400.0,
            "rest_position": 0.004,
            "rest_attitude": 0.02,
            "thrust_weight": 1.0,
            "price": (0.2, 80.0),
        },
        replace(_SOON, reward_scale=0.012, gamma=0.99, layers=_WIDE),
        60_000_000,
        (Ramp("thrust_weight", 0.1, 30_000_000, shape="geometric"), *_THERE),
        large=_WIDEST,
        large_timesteps=4_000_000_000,
        episode_steps=100,
    ),
    "go-to-pose-2d-robust": Recipe(
        "go-to-pose",
        _PLATFORM,
        {**_LOOSE, **_ARRIVED, "verge_weight": 40.0, "thrust_weight": 0.35},
        replace(
            _SOON,
            n_envs=512,
            n_steps=32,
            layers=(128, 64),
            reward_scale=0.05,
            **_FILTERED | {"filters": (0.01, 0.3)},
        ),
        60_000_000,
        (_PRICED_LATE, _STAYED),
        partial(robust_poses, valves=9.0, missed=8.0),
        {
            **_ADAPTIVE_LARGE,
            **_FILTERED,
            "history": 1,
            "filtered_response": (0.05, 3.0),
            "privileged_critic": True,
        },
        1_800_000_000,
    ),
    **{
        f"{task}-2d-robust": Recipe(
            task,
            _PLATFORM,
            settings,
            replace(_INFORMED, symmetric=TASKS[task].symmetric),
            10_000_000,
            (_PRICED_LATE,),
            robust,
            _ADAPTIVE_LARGE,
            _STEADY_STEPS[task],
        )
        for task, settings in _STEADY.items()
    },
    "go-to-pose-2d-faults": Recipe(
        "go-to-pose",
        _PLATFORM,
        {
            **_LOOSE,
            **_ARRIVED,
            "arrived_weight": 8.0,
            "arrived_fine_weight": 2.7,
            "verge_weight": 20.0,
            "thrust_weight": 0.05,
        },
        replace(_INFORMED, reward_scale=0.04),
        60_000_000,
        (_PRICED_LATE, _STAYED),
        partial(failing_in_other_bodies, 0.04),
        _WIDEST,
        6_000_000_000,
    ),
    "go-to-pose-2d-shared": Recipe(
        "go-to-pose",
        _SHARED,
        {
            "fine_weight": 1.0,
            "fine_position_scale": 0.006,
            "fine_attitude_scale": 0.006,
            "rest_position": 0.007,
            "rest_attitude": 0.01,
            "thrust_weight": 0.175,
            "spin_weight": 0.08,
        },
        _STILL,
        40_000_000,
        (Ramp("fine_weight", 0.3, 25_000_000, 2_500_000, "geometric"),),
    ),
    "go-to-position-2d-shared": Recipe(
        "go-to-position",
        _SHARED,
        {**_HOLD, "rest_spin": 0.03, "thrust_weight": 0.15},
        _STILL,
        25_000_000,
        (Ramp("thrust_weight", 0.06, 15_000_000, 5_000_000, "geometric"),),
    ),
    "track-velocity-2d": Recipe(
        "track-velocity", _PLATFORM, _VELOCITY, replace(_PLANE, symmetric=False)
    ),
    "track-twist-2d-shared": Recipe(
        "track-twist",
        _SHARED,
        _TWIST,
        _STILL,
        10_000_000,
        (Ramp("thrust_weight", 0.01, 5_000_000, 1_250_000, "geometric"),),
    ),
    "track-velocity-heading-2d": Recipe(
        "track-velocity-heading", _PLATFORM, {"fine_scale": 0.02}, _PLANE, 12_000_000
    ),
    "multi-task-2d": Recipe(
        "multi-task",
        _PLATFORM,
        _EVERY,
        replace(_SHARP, initial_duty=0.3, layers=_WIDE),
        24_000_000,
        large=_SOON_LARGE,
        large_timesteps=1_200_000_000,
    ),
    "go-to-pose-3d": Recipe(
        "go-to-pose",
        _FLYER,
        {
            "fine_weight": 1.5,
            "arrived_weight": 10.0,
            "arrived_fine_weight": 4.0,
            "arrived_squarings": 4,
            "arrived_within": 0.65,
            "arrived_thrust_weight": 1.0,
            "rest_position": 0.01,
            "rest_attitude": 0.02,
            "thrust_weight": 0.15,
            "spin_weight": 0.1,
            "verge_weight": 30.0,
        },
        replace(_SOON, layers=_WIDE, reward_scale=0.05),
        62_500_000,
        (Ramp("thrust_weight", 0.04, 12_000_000, shape="geometric"), _STAYED),
        large=_SOON_LARGE,
        large_timesteps=3_600_000_000,
    ),
    "go-to-pose-3d-robust": Recipe(
        "go-to-pose",
        _FLYER,
        {
            **_ARRIVED,
            "arrived_weight": 3.0,
            "arrived_fine_weight": 1.0,
            "arrived_thrust_weight": 1.4,
            "arrived_spin": 0.35,
            "fine_weight": 1.0,
            "rest_position": 0.03,
            "rest_attitude": 0.05,
            "verge_weight": 22.0,
            "thrust_weight": 0.2,
        },
        replace(_INFORMED, layers=_WIDE, reward_scale=0.07, **_FILTERED | _TRUSTING),
        60_000_000,
        (_PRICED_LATE, _STAYED_LATER),
        partial(robust_poses, valves=12.0, noise=10.0, lab=24.0, missed=8.0),
        _SOON_LARGE,
        3_650_000_000,
        _COARSE,
    ),
    "go-to-position-3d-robust": Recipe(
        "go-to-position",
        _FLYER,
        _STEADY["go-to-position"],
        replace(_INFORMED, symmetric=TASKS["go-to-position"].symmetric, layers=_WIDE),
        10_000_000,
        (_PRICED_LATE,),
        robust,
        _ADAPTIVE_LARGE,
        400_000_000,
        _COARSE,
    ),
    **{
        f"{task}-3d-robust": Recipe(
            task,
            _FLYER,
            _TRACKED,
            replace(_INFORMED, symmetric=TASKS[task].symmetric, layers=_WIDE, **_FILTERED),
            10_000_000,
            (_PRICED_LATE,),
            robust,
            _SOON_LARGE,
            steps,
            _COARSE,
        )
        for task, steps in _TRACKED_STEPS.items()
    },
    "go-to-pose-3d-faults": Recipe(
        "go-to-pose",
        _FLYER,
        {**_LOOSE, "thrust_weight": 0.06},
        replace(_INFORMED, layers=_WIDE),
        12_000_000,
        (_PRICED_LATE,),
        failing_in_other_bodies,
        _SOON_LARGE,
        6_400_000_000,
        _COARSE,
    ),
    "go-to-position-3d": Recipe(
        "go-to-position",
        _FLYER,
        {
            "fine_weight": 0.5,
            "rest_position": 0.007,
            "rest_spin": 0.03,
            "thrust_weight": 0.05,
            "evaluation_distance": (1.0, 5.0),
            "spawn_distance": (0.5, 5.5),
        },
        replace(_STILL, layers=_WIDE),
        6_000_000,
    ),
    "track-velocity-3d": Recipe(
        "track-velocity", _FLYER, _VELOCITY, replace(_PLANE, symmetric=False, layers=_WIDE)
    ),
    "track-twist-3d-shared": Recipe(
        "track-twist",
        _FLYER_SHARED,
        {
            **_TWIST,
            "fine_weight": 0.8,
            "fine_spin_weight": 1.5,
            "fine_spin_scale": 0.025,
            "thrust_weight": 0.01,
        },
        replace(_STILL, layers=_WIDE),
        20_000_000,
        _SHUT_FIRST,
    ),
    "track-velocity-heading-3d": Recipe(
        "track-velocity-heading",
        _FLYER,
        {"fine_scale": 0.02},
        replace(_PLANE, layers=_WIDE),
        8_000_000,
    ),
    "multi-task-3d": Recipe(
        "multi-task",
        _FLYER,
        _EVERY_WITHIN,
        replace(_SHARP, initial_duty=0.3, layers=_WIDE),
        16_000_000,
        large=_WIDEST,
        large_timesteps=5_800_000_000,
    ),
}
"""By the agent's name."""


_GRADIENT: dict[str, Any] = {
    "n_envs": 256,
    "n_steps": 16,
    "batch_size": 1024,
    "n_epochs": 4,
    "learning_rate": 3e-3,
}
"""Of a learner through the motion, of any throttled craft (decision 026)."""
_GRADIENT_REPORTS = 24
"""Its iterations between reports, as many steps as between those of PPO."""


def recipe(name: str, device: str) -> TrainConfig:
    """The training that the agent of this name, one of `RECIPES`, comes from on this device.

    A GPU takes a larger network through `_LONGER` times the steps, or more, in less time than a CPU core its
    own.
    """
    given = RECIPES[name]
    large = not device.startswith("cpu")
    times = _LONGER if large else 1
    steps = given.total_timesteps * times
    ramps = tuple(
        replace(ramp, duration=ramp.duration * times, begin=ramp.begin * times)
        for ramp in given.curriculum
    )
    return TrainConfig(
        given.task,
        TASKS[given.task](**given.settings),
        given.spacecraft,
        replace(given.ppo, **(_LARGE | given.large)) if large else given.ppo,
        timing=given.timing,
        episode_steps=given.episode_steps,
        conditions=given.conditions(),
        curriculum=ramps,
        failures=given.failures if large else Failures(),
        device=device,
        solved_share=None,
        total_timesteps=(large and given.large_timesteps) or steps,
        report_interval=64,
    )


def training(
    task: str, spacecraft: str = "floating-platform", device: str | None = None
) -> TrainConfig:
    """The training of this name: a task with its defaults and known-good settings, or a recipe.

    Args:
        task: of `TASKS` or `RECIPES`, or MODULE:NAME.
        spacecraft: name or TOML file; a recipe has its own.
        device: cpu or cuda; None: a GPU if there is one.

    Raises:
        ConfigError: there is no such task or spacecraft.
    """
    device = device or ("cuda" if torch.cuda.is_available() else "cpu")
    if task in RECIPES:
        return recipe(task, device)
    if task not in TASKS and ":" not in task:
        raise ConfigError(
            f"there is no task and no recipe named {brief(task)}"
            f"{meant(task, [*TASKS, *RECIPES])}; tasks are {', '.join(TASKS)}; "
            f"recipes are {', '.join(RECIPES)}."
        )
    settings = TASKS[task]()
    craft = load_spacecraft(spacecraft)
    TASKS.vouch_for(task)  # typed or given as an object: what is trained with it can be opened here
    return TrainConfig(
        task, settings, spacecraft, preset(task, craft.dimension, device), device=device
    )


def preset(task: str, dimension: int, device: str) -> PPOSettings:
    """The known-good settings; on another kind of device those for a GPU, for your own task the usual."""
    body = dimension, "cpu" if device.startswith("cpu") else "cuda"
    return replace(_MANY.get((task, *body), _BY_BODY[body]), symmetric=TASKS[task].symmetric)


def by_gradient(config: TrainConfig) -> TrainConfig:
    """The same training by the gradient through the motion, with numbers that are known to work."""
    return replace(
        config,
        algorithm="gradient",
        ppo=replace(config.ppo, **_GRADIENT),
        report_interval=_GRADIENT_REPORTS,
    )
