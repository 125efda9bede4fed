"""RLtools' PPO, compiled with its own pendulum by the system's C++ compiler, with our preset's sizes."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from ppo_settings import SETTINGS
from stopwatch import options, say, steps_per_second

_ENVIRONMENT = """
#include <rl_tools/rl/environments/pendulum/operations_cpu.h>
namespace environments = rl_tools::rl::environments;
template <typename T, typename TI>
using ENVIRONMENT_FACTORY = environments::Pendulum<environments::pendulum::Specification<T, TI>>;
"""
"""Its compiler looks for this in the file environment.h."""


def main() -> None:
    """Measure and print."""
    given = options()
    ours = SETTINGS["cpu"]
    os.environ["MKL_NUM_THREADS"] = "1"  # as our trainer does
    with tempfile.TemporaryDirectory() as folder:
        tempfile.tempdir = folder  # where it keeps what it compiles
        (Path(folder) / "environment.h").write_text(_ENVIRONMENT)
        import rltools

        trainer = rltools.PPO(
            {"path": folder},
            enable_evaluation=False,
            STEP_LIMIT=10**9,
            N_ENVIRONMENTS=ours.n_envs,
            ON_POLICY_RUNNER_STEPS_PER_ENV=ours.n_steps,
            BATCH_SIZE=ours.batch_size,
            N_EPOCHS=ours.n_epochs,
            **_network("ACTOR", ours.layers),
            **_network("CRITIC", ours.layers),
        ).State(0)
        rate = steps_per_second(trainer.step, ours.rollout, given.seconds)
    say(
        "rltools",
        "pendulum, in C++",
        f"step() of one iteration, {ours}, actor and critic apart, MKL",
        ours.n_envs,
        "cpu",
        trained_steps_per_s=rate,
    )


def _network(of: str, layers: tuple[int, ...]) -> dict[str, int | str]:
    """Its layers are all as wide; it counts the one that answers."""
    return {
        f"{of}_HIDDEN_DIM": layers[0],
        f"{of}_NUM_LAYERS": len(layers) + 1,
        f"{of}_ACTIVATION_FUNCTION": "TANH",
    }


if __name__ == "__main__":
    main()
