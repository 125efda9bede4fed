"""``rans train``: train an agent for a task and a spacecraft."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import signal
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import UseAppendAction, arg

from rans.api.judging import compare
from rans.api.training import as_it_comes, config_of, ready_trainer, train
from rans.base.errors import (
    ConfigError,
    brief,
    meant_file,
)
from rans.base.files import command_line, inside
from rans.base.registry import typed
from rans.base.system import ALARMS, ENDS, set_alarm
from rans.base.terminal import Terminal, doing
from rans.cli import STARTED
from rans.cli.door import Options, command_of, word
from rans.cli.numbers import whole_number
from rans.model.spacecraft_file import effector_kind, load_spacecraft
from rans.show.progress import TrainingProgress

if TYPE_CHECKING:
    from rans.fast.learn.config import TrainConfig
    from rans.fast.learn.trainer import Trainer
    from rans.model.spacecraft import Spacecraft

_GENTLE = 30.0
"""Largest time that an iteration may continue after Ctrl-C, s."""


@command_of(
    train,
    without=("ppo", "algorithm", "guard", "plain", "progress", "report"),
    defaults={"task": None},
    task=word("[TASK]", str | None),
)
class Train(Options):
    """Train an agent until it has solved its task, by imitation of any craft where that flies it, or by --rl.

    The run folder has the config, metrics, checkpoints, TensorBoard events and the agent,
    agent.safetensors. Ctrl-C stops early and keeps everything.
    """

    group = "Train"
    guide = "docs/training.md"
    examples = (
        "rans train go-to-pose --output runs/my-agent",
        "rans train go-to-pose --rl --output runs/from-nothing",
        "rans train go-to-pose --spacecraft mine.toml --conditions lab --quality good",
        "rans train go-to-pose --set thrust_weight=0.1 --set learning_rate=5e-4",
        "rans train --resume runs/my-agent",
    )
    following = ("rans list AGENTS",)

    set: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KEY=VALUE")] = ()
    """Change an entry of the config (see `rans list TRAINING`), as in `--set ppo.gamma=0.98`
    or `--set guard=true`; may be repeated."""
    resume: Path | None = None
    """Continue the training in this run folder from its last checkpoint, or start it if there is none; beyond its
    steps with `--total-timesteps N`, which counts those before too."""
    rl: bool = False
    """Train by reinforcement learning from random weights, where a training would begin by imitation."""

    def _trainer(self) -> Trainer:
        """Trainer that is ready to train; a new run folder is created after its config has been checked."""
        from rans.evaluation.fly.make_controller import guard_of
        from rans.fast.distributed import join
        from rans.fast.learn.run_folder import RunFolder
        from rans.fast.learn.trainer import Trainer, is_solved

        if self.resume is None:
            config = self.begun()
            return ready_trainer(config, load_spacecraft(config.spacecraft), self.output)
        total = self.total_timesteps
        run_folder = RunFolder(self.resume)
        config = run_folder.config()
        config = replace(config, plain="plain=true" in self.set or config.plain)
        if total is not None:
            config = replace(config, total_timesteps=total)
            if is_solved(config, run_folder.metrics()):
                config = replace(config, solved_share=None)  # or nothing would be trained
        craft = run_folder.spacecraft()
        world = join(config.device)
        trainer = Trainer(config, craft, run_folder, world, guard=guard_of(config, craft))
        trainer.resume()
        if total is not None:
            if total <= trainer.steps:
                raise ConfigError(
                    f"{self.resume} has {trainer.steps:,} steps already, and total_timesteps is the number "
                    f"at the end, these included: give more than that, got {total:,}."
                )
            if world.is_first:
                run_folder.extend(config, command_line())
        return trainer

    def _check(self) -> None:
        """Reject (`ConfigError`) what is wrong with the folders, before anything is prepared."""
        from rans.fast.learn.run_folder import RunFolder

        if self.resume is None:
            if self.output is not None:
                RunFolder(self.output).check_unused()
            return
        if not self.resume.exists():
            near = meant_file(self.resume)
            raise ConfigError(
                f"{self.resume} is not a run folder: there is nothing of that name{near}."
            )
        rest = tuple(change for change in self.set if not change.startswith("plain="))
        own = replace(self, resume=None, total_timesteps=None, set=rest)
        if own != Train():
            raise ConfigError(
                "--resume reads everything from the run folder but the number of steps, which "
                "--total-timesteps N raises; give no other options. To change more, start again with "
                f"rans train {self.resume / 'config.json'}."
            )
        RunFolder(self.resume).config()

    def begun(self) -> TrainConfig:
        """Config of the training, which as it comes begins from the agent for any craft."""
        from rans.fast.learn.config import craft_of

        config = self.resolved()
        otherwise = self.rl, self.set, self.total_timesteps, self.conditions
        return as_it_comes(config, craft_of(config), self.task, self.quality, *otherwise)

    def resolved(self) -> TrainConfig:
        """Config of a preset or of another run, with the changes of the options."""
        if self.task is None:
            raise ConfigError(
                "say what to train: a task, such as go-to-pose, the config.json of a run, or --resume RUN to "
                "train on."
            )
        changes = _changes(self.set)
        if self.rl and changes.get("begin_from"):
            raise ConfigError(
                "--rl trains from random weights, and begin_from begins otherwise: give one of them."
            )
        return config_of(
            typed(self.task),
            self.spacecraft,
            self.device,
            self.conditions,
            self.quality,
            changes.pop("algorithm", None),
            changes=changes,
            seed=self.seed,
            total_timesteps=self.total_timesteps,
        )

    def run(self) -> int:
        """Train with progress; the exit code is 130 or 143 if it was stopped early."""
        self._check()
        from rans.fast.device import open_ahead

        if self.device != "cpu":
            open_ahead()
        with doing("preparing the training", in_log=False):
            trainer = self._trainer()
        if not trainer.processes.is_first:
            with StopGently() as stop:
                trainer.train(stop=stop)
            return stop.code
        begun_at = trainer.steps
        console = Terminal()
        if trainer.imitates and trainer.steps == 0:
            begins = f"This training begins by imitation of {trainer.imitates}"
            if trainer.config.solved_share is not None:
                begins += ", and ends as soon as that solves the task; without imitation: add --rl"
            console.say(f"{begins}.")
        with TrainingProgress(trainer.config.total_timesteps) as progress, StopGently() as stop:
            trainer.train(progress.show, stop)
        console.say(_summary(trainer, begun_at, stop.requested, time.monotonic() - STARTED))
        # No page has the safety filter.
        is_shown = not (stop.requested or trainer.config.guard)
        if is_shown and (page := _live_page(trainer.run.path)):
            console.say(f"Open {page} in a browser to see it fly.")
        if not stop.requested or trainer.ended:
            untrained = _without_training(trainer)
            rival = ""
            if untrained:
                said, rival = _verdict(trainer, untrained)
                console.say(said)
            console.suggest(*self._next(trainer, untrained, rival))
        return stop.code

    def _next(self, trainer: Trainer, untrained: str = "", rival: str = "") -> list[str]:
        """Commands to run next, with the options that this run needs too (`tests/cli/test_printed.py`).

        A comparison has the agent for any craft too, if one is named that flies this task and craft ``untrained``.
        A ``rival`` beside which nothing was gained is evaluated first.
        """
        from rans.fast.learn.learners import LEARNERS

        path = str(trainer.run.path)
        guard = ["--guard"] if trainer.config.guard else []
        same = [*guard, *trust_option(trainer.config, trainer.engine.craft)]
        config = trainer.config
        learner = LEARNERS[config.algorithm].contestants(config, trainer.run.path)
        rivals = [*_judged(trainer), *learner, *filter(None, [untrained])]
        commands = [
            shlex.join(["rans", "evaluate", rival or path, *same]),
            shlex.join(["rans", "compare", *rivals, *same]),
        ]
        is_quick = self.quality in (None, "quick") and trainer.config.solved_share is not None
        # The config of a run says how long to train.
        if is_quick and self.task is not None and not self.task.endswith(".json"):
            words = ["rans", "train", self.task, *self.changed("spacecraft", "conditions")]
            # Settings of the task say what is asked and observed; others may contradict the quality.
            settings = [change for change in self.set if _is_setting(trainer.config, change)]
            for change in ["guard=true"] * len(guard) + settings:
                words += ["--set", change]
            better = shlex.join([*words, "--quality", "good"])
            commands.append(f"{better}   # a better agent, in minutes")
        return commands


def _without_training(trainer: Trainer) -> str:
    """The agent for any craft with the craft of a nominal training, by name; "" if it cannot fly that."""
    from rans.cli.compare import without_training
    from rans.evaluation.compare.entrants import contest_of
    from rans.evaluation.fly.contestant_name import ContestantName

    config = trainer.config
    is_nominal = not config.guard and config.conditions.or_none is None
    if not is_nominal or trust_option(config, trainer.engine.craft):
        return ""
    name = ContestantName.parse(_judged(trainer)[0])
    return without_training([name], contest_of(name, 1))


_CHEAPER = 0.5
"""Value of the agent for any craft that flies beside the one that its flights choose: most trainings cost more time
or thrust than one of both."""


def _verdict(trainer: Trainer, untrained: str) -> tuple[str, str]:
    """What to take of the agent and the one ``untrained`` at two values, by flights from the same starts.

    Then the contestant beside which nothing was gained, "" where the agent is worth its training.
    """
    from rans.evaluation.fly.choice import FLIGHTS
    from rans.evaluation.fly.contestant_name import ContestantName
    from rans.show.tables.comparison_tables import recommended, verdict

    own = _judged(trainer)
    starts = FLIGHTS[trainer.engine.craft.dimension]
    name = ContestantName.parse(untrained)
    rivals = [untrained, name.at(_CHEAPER).text]
    comparison = compare(*own, *rivals, beside=(), episodes=starts)
    agent = name.name
    taken = recommended(comparison)
    is_gained = not taken.startswith(f"{agent}#")
    said = f"Beside {agent}, which needs no training, from {starts} starts:"
    if not is_gained:
        said = f"Nothing was gained by this training. {said}"
    text = " ".join([said, *verdict(comparison), *comparison.failures])
    return text, "" if is_gained else f"{taken}@{name.craft}"


def _judged(trainer: Trainer) -> list[str]:
    """Names under which a comparison flies the agent: at three trade-offs, and of several tasks the first."""
    path, task = str(trainer.run.path), trainer.config.settings
    parts = ["0", "0.5", "1"] if task.draws_trade_off else [next(iter(task.parts()))]
    return [f"{path}#{part}" if part else path for part in parts]


def _is_setting(config: TrainConfig, change: str) -> bool:
    """Whether a word KEY=VALUE, which has changed the config, changes a setting of the task."""
    from rans.fast.learn.config import entry_named, to_table

    return entry_named(to_table(config), change.partition("=")[0]).startswith("settings.")


def trust_option(config: TrainConfig, craft: Spacecraft) -> list[str]:
    """--trust, if the files of a training name code as MODULE:NAME, which commands then run; else nothing."""
    expert = str(config.learner.get("expert", ""))
    kinds = map(effector_kind, craft.further_effectors)
    # Files of a run have the spacecraft itself, so that nothing loads the one that its config names.
    named = (config.task, config.algorithm, expert, *kinds)
    return ["--trust"] if any(":" in name for name in named) else []


def _summary(trainer: Trainer, begun: int, stopped: bool, seconds: float) -> str:
    """Paragraph about a training: its ending, its steps since ``begun``, its time and its folder."""
    path = trainer.run.path
    trust = trust_option(trainer.config, trainer.engine.craft)
    if trainer.steps == begun and not stopped:
        return (
            f"Nothing was left to train: {path} has {begun:,} steps. Train on with: "
            f"{command_to_train_on(path, begun, trust)}"
        )
    again = shlex.join(["rans", "train", "--resume", str(path), *trust])
    if not trainer.steps:
        return (
            "Stopped in the imitation with which the training begins: nothing of it is kept, and "
            f"{path} has no agent yet. Begin anew with: {again}"
        )
    # How it ended, and what it took.
    stopped = stopped and not trainer.ended
    ending = (
        "Stopped"
        if stopped
        else f"Solved, {100.0 * (trainer.config.solved_share or 1.0):.4g} % of its flights or more,"
        if trainer.solved
        else "Done"
        if trainer.config.solved_share is None
        else "Out of steps, not solved"
    )
    warm_up = f" after {trainer.warm_up:.1f} s of warm-up" if trainer.warm_up else ""
    description = trainer.learner.description
    backend = f", {description}" if description else ""
    is_copy = trainer.imitates and len(trainer.rows) == 1
    how = f" of imitation of {trainer.imitates}" if is_copy else ""
    text = (
        f"{ending} after {trainer.steps:,} steps{how}: {trainer.seconds:.1f} s of training "
        f"({trainer.rate:,.0f} steps/s{backend}){warm_up}, {seconds:.1f} s in all. "
        f"The agent is {path}."
    )
    # What to do next, where the task is not solved.
    if stopped:
        text += f" Continue with: {again}"
    elif trainer.config.solved_share is not None and not trainer.solved:
        advice = (
            f"{trainer.rows[-1]['success']:.0%} of its last episodes are solved. More steps may "
            f"solve it: {command_to_train_on(path, trainer.steps, trust)}; or another --seed."
        )
        text += f" {advice} Its learning curve: {shlex.join(['rans', 'report', str(path)])}"
    return text


def _live_page(path: Path) -> Path | None:
    """The page in which the agent flies, in its run folder; None: no page computes its policy or its task."""
    from rans.evaluation.fly.agent import load_policy
    from rans.fast.learn.run_folder import FLY
    from rans.show.pages.playground import playground

    with doing("writing the page in which it flies", in_log=False):
        try:
            page = playground(load_policy(path))
        except ConfigError:
            return None
        file = inside(path, FLY)
        page.write(file)
    return file


def command_to_train_on(path: Path, steps: int, trust: Sequence[str] = ()) -> str:
    """Command line that trains the agent of a run folder on, to twice as many steps.

    The number is rounded down to two digits; ``trust`` is what `trust_option` gives.
    """
    digits = 10 ** max(0, len(str(2 * steps)) - 2)
    total = max(1, 2 * steps // digits) * digits
    words = ["rans", "train", "--resume", str(path), "--total-timesteps", str(total), *trust]
    return shlex.join(words)


_COUNT = re.compile(r"[0-9][0-9_.]*[kMG]?")
"""A count as people write it, such as 1M or 1_000_000, which JSON does not have."""


def _changes(words: Sequence[str]) -> dict[str, Any]:
    """Values by name of words KEY=VALUE, read by `value_of`; a name may come once (`ConfigError`)."""
    changes: dict[str, Any] = {}
    for change in words:
        key, equals, text = change.partition("=")
        if not equals:
            raise ConfigError(f"--set takes KEY=VALUE, got {brief(change)}.")
        if key in changes:
            raise ConfigError(f"--set {key} is given twice: leave one of them out.")
        changes[key] = value_of(text)
    return changes


def value_of(text: str) -> Any:
    """A value as JSON, as a count, or else as text."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return whole_number(text) if _COUNT.fullmatch(text) else text


class StopGently:
    """Context in which a signal requests a stop after the iteration; a second one or a long wait interrupts it.

    An interrupt loses only the iteration, because checkpoints are frequent. Windows waits without an end. Trainings
    call it after every iteration to ask whether to stop. In the first one, in which kernels are compiled, a signal
    interrupts at once, because nothing is lost.
    """

    requested = False
    _has_begun = False
    code = 0
    """Exit code: 0, or once a stop was requested 128 and the signal's number: 130 of Ctrl-C, 143 of SIGTERM."""

    def __enter__(self) -> StopGently:
        self._before = {
            number: signal.signal(number, self._ask)
            for number in (*ENDS, *ALARMS)
            if signal.getsignal(number) != signal.SIG_IGN  # as nohup ignores SIGHUP
        }
        return self

    def __exit__(self, *_: object) -> None:
        set_alarm(0.0)
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __call__(self) -> bool:
        """Whether a stop was requested; asked after every iteration."""
        self._has_begun = True
        return self.requested

    def _ask(self, number: int, frame: FrameType | None) -> None:
        """Ask the training to stop at the first signal; at the second one, or before it has begun, end at once.

        Sets ``requested`` and ``code``, which the training loop reads.
        """
        if not self.requested:
            self.requested = True
            self._number = number
            self.code = 128 + number
            if self._has_begun:
                set_alarm(_GENTLE)
                if os.environ.get("RANK", "0") == "0":
                    said = b"\nrans: stopping after this iteration; Ctrl-C again stops at once.\n"
                    # Not by a buffered stream, which may be in use when a signal comes.
                    with contextlib.suppress(OSError):
                        os.write(2, said)
                return
        interrupt = self._before.get(signal.SIGINT)  # the previous handler may defer it
        (interrupt if callable(interrupt) else signal.default_int_handler)(self._number, frame)
