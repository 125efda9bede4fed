"""``rans sweep``: trainings with several seeds and hyper-parameters."""

from __future__ import annotations

import json
import shlex
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import UseAppendAction, arg

from rans.api.training import members, ready_sweep, sweep
from rans.cli import STARTED
from rans.cli.door import Options, command_of, word
from rans.cli.train import compile_in_this_process, trust_option, value_of
from rans.errors import ConfigError, counted
from rans.registry import typed
from rans.show.progress import NowAndThen
from rans.terminal import Terminal

if TYPE_CHECKING:
    from rans.fast.learn.config import TrainConfig
    from rans.fast.learn.sweep import Sweep as Trainings


@command_of(
    sweep,
    without=("spacecraft", "device", "total_timesteps", "conditions", "algorithm"),
    defaults={"task": None},
    task=word("[TASK]", str | None),
)
class Sweep(Options):
    """Train many agents, for every seed and every combination of hyper-parameters.

    The folder has sweep.json, metrics.jsonl, the run folders of all agents in members/, and that of the
    best one as best/. Ctrl-C stops early and keeps the results. --executor trains on other machines, which must see
    the folder.
    """

    group = "Train"
    guide = "docs/sweep.md"
    examples = (
        "rans sweep go-to-pose --seeds 8",
        "rans sweep go-to-pose --set learning_rate=1e-3,3e-4 --set gamma=0.98,0.99",
    )
    following = ("rans list AGENTS",)

    set: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KEY=VALUE,VALUE")] = ()
    """Values of an entry of the config (see `rans list TRAINING`), as in
    `--set ppo.gamma=0.98,0.99`, `--set spacecraft=mine.toml` or `--set conditions=lab`; may be repeated."""
    resume: Path | None = None
    """Continue the sweep in this folder from its last checkpoints."""

    def run(self) -> int:
        """Train with progress and print a table; the exit code is 130 or 143 if it was stopped early."""
        compile_in_this_process()
        sweep = self._trainings()
        folder = sweep.path
        first = sweep.processes.is_first
        plain = NowAndThen()
        # Train; the first of torchrun's processes reports and writes.
        stopped = False
        try:
            sweep.train(lambda _: plain.say(f"sweep: {progress(sweep)}") if first else None)
        except KeyboardInterrupt:
            stopped = True
        code = 130 if stopped else 0
        if not first:
            return code
        from rans.fast.learn.config import craft_of
        from rans.show.pages.report import sweep_table
        from rans.show.sweep_files import save_sweep

        config = sweep.members[0].config
        trust = trust_option(config, craft_of(config))
        again = shlex.join(["rans", "sweep", "--resume", str(folder), *trust])
        if not sweep.has_agent:
            how = "Stopped before any agent" if stopped else "All members diverged"
            Terminal().say(f"{how}; {folder} has none. Begin anew with: {again}")
            return code or 1
        save_sweep(sweep, folder)
        best = sweep.members.index(sweep.best())
        Terminal().table(sweep_table({"members": sweep.results(), "best": best}))
        solved = sum(member.solved for member in sweep.members)
        rate = f" ({sweep.timed_steps / max(sweep.seconds, 1e-9):,.0f} steps/s of all together)"
        trained = "nothing was left to train" if not sweep.timed_steps else ""
        text = (
            f"{'Stopped' if stopped else 'Done'}: {solved} of "
            f"{counted(len(sweep.members), 'member')} solved, "
            f"{trained or f'{sweep.seconds:.1f} s of training{rate}'}, "
            f"{time.monotonic() - STARTED:.1f} s in all. The best agent is {folder}/best."
        )
        # What to do next: go on, or judge the best.
        if stopped:
            text += f" Continue with: {again}"
        Terminal().say(text)
        if not stopped:
            Terminal().suggest(
                shlex.join(["rans", "evaluate", str(folder / "best"), *trust]),
                shlex.join(["rans", "report", str(folder)]),
            )
        return code

    def _trainings(self) -> Trainings:
        """Sweep that is ready to train: of the options, or of the folder that --resume names and nothing else."""
        from rans.fast.distributed import join
        from rans.fast.learn.sweep import Sweep as Trainings
        from rans.fast.learn.sweep import read_configs

        if self.resume is not None:
            if replace(self, resume=None) != Sweep():
                raise ConfigError(
                    "--resume reads everything from the sweep's folder; give no other options."
                )
            configs, command = read_configs(self.resume)
            return Trainings(configs, self.resume, command, join(configs[0].device, apart=True))
        return ready_sweep(self._configs(), self.output)

    def _configs(self) -> list[TrainConfig]:
        """Configs of all combinations."""
        if self.task is None:
            raise ConfigError("say what to train: a task, such as go-to-pose, or --resume SWEEP.")
        return members(typed(self.task), dict(map(_choices, self.set)), self.seeds)


def _choices(text: str) -> tuple[str, list[Any]]:
    """Name and values of KEY=V1,V2; values are JSON, or else text."""
    key, equals, values = text.partition("=")
    if not equals or not values:
        raise ConfigError(f"--set takes KEY=VALUE or KEY=VALUE,VALUE,..., got {text!r}.")
    try:
        return key, json.loads(f"[{values}]")
    except (ValueError, RecursionError):
        return key, [*map(value_of, values.split(","))]


def progress(sweep: Trainings) -> str:
    """Members that have begun, and how many are solved, as one line of a log."""
    solved = sum(member.solved for member in sweep.members)
    return f"{len(sweep.results())} of {len(sweep.members)} have results, {solved} solved"
