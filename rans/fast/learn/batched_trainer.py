"""Members of a sweep trained as one batch, until each is solved or out of steps."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean
from typing import Any

import torch
from torch import Tensor

from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.fast.learn.batched import BatchedPPO, Start
from rans.fast.learn.batched_network import Network, write_weights
from rans.fast.learn.config import TrainConfig
from rans.fast.learn.graph import fused, graphed
from rans.fast.learn.members import MembersEngine
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.selection import EPISODES, judged_flight
from rans.fast.learn.trainer import SOLVED_IN_A_ROW, WARM_UP_ITERATIONS, check_device, make_ppo
from rans.files import replace_file
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import SELECTION_SEED
from rans.tasks import Task


@dataclass
class Member:
    """One training of a sweep, and how it went."""

    config: TrainConfig
    rows: list[dict[str, Any]] = field(default_factory=list)
    """As in ``metrics.jsonl``, up to the report that found it solved."""
    weights: dict[str, Tensor] = field(default_factory=dict)
    """Of the agent at its last row (`Network.member`)."""
    _in_a_row: int = 0

    @property
    def solved(self) -> bool:
        """Whether enough reports in a row found the task solved."""
        return self._in_a_row >= SOLVED_IN_A_ROW

    @property
    def diverged(self) -> bool:
        """Whether a weight became NaN or infinite."""
        return not all(tensor.isfinite().all() for tensor in self.weights.values())

    def note(self, row: dict[str, Any]) -> None:
        """Keep a report, and judge as `Trainer` whether the task is solved."""
        self.rows.append(row)
        needed = self.config.solved_share
        found = needed is not None and row["success"] >= needed
        self._in_a_row = self._in_a_row + 1 if found else 0

    def save(self, path: Path, command: str) -> None:
        """Write config, metrics and agent into a new run folder.

        Raises:
            ConfigError: the disk refused, or the folder holds a training.
        """
        run, model = RunFolder(path), begin(self.config).model
        run.begin(self.config, command)
        for row in self.rows:
            run.append_metrics(row)
        write_weights(model.policy, self.weights)
        replace_file(run.policy_file, model.save)


def begin(config: TrainConfig) -> Start:
    """The training of this config before its first step, as `Trainer` would begin it on a CPU.

    Raises:
        ConfigError: the config cannot work.
    """
    check_device(config.device)
    if config.curriculum:
        raise ConfigError("a sweep cannot train with a curriculum; use rans train, or --set curriculum=[].")
    craft = load_spacecraft(config.spacecraft)
    engine = Engine(craft, config.settings, config.ppo.n_envs, config.timing, seed=config.seed)
    model = make_ppo(engine, config.ppo, config.seed)
    model.start()
    return Start(model, torch.get_rng_state())


class BatchedTrainer:
    """Members that differ in seed, coefficients and numbers among the task's settings only.

    Sets torch's number of threads, for the whole process.

    Args:
        members: to train.
    """

    def __init__(self, members: Sequence[Member]) -> None:
        self.members, self.config, self.seconds, self.warm_up = members, members[0].config, 0.0, 0.0
        torch.set_num_threads(self.config.threads)
        device = torch.device(self.config.device)
        if device.type == "cuda":
            torch.compiler.reset()  # what earlier batches compiled counts towards the compiler's limit
        self.ppo = BatchedPPO([begin(member.config) for member in members], device)
        self._selection = _Selection(self.ppo, [member.config.settings for member in members])
        self._iterations = self._untimed = 0

    @property
    def steps(self) -> int:
        """Environment steps of each member."""
        return self._iterations * self.ppo.each * self.ppo.n_steps

    @property
    def timed_steps(self) -> int:
        """Those of all members that ``seconds`` went into; a solved member's batch goes on."""
        return (self.steps - self._untimed) * len(self.members)

    def train(self, report: Callable[[Sequence[Member]], object], stop: Callable[[], bool]) -> None:
        """See `rans.fast.learn.sweep.Sweep.train`."""
        self._warm_up()
        stopped, begun = False, time.monotonic()
        if self._ended():  # the warm-up took all steps
            self._report()
            report(self.members)
        while not (stopped or self._ended()):
            self._iterate()
            stopped = stop()
            if stopped or self._ended() or self._iterations % self.config.report_interval == 0:
                self._wait()
                self.seconds += time.monotonic() - begun
                self._report()
                report(self.members)
                begun = time.monotonic()
        for number in self._running():
            self._keep(number)

    def _warm_up(self) -> None:
        """On a GPU, compile and record everything; training is timed from then on."""
        if self.ppo.device.type == "cuda":
            begun = time.monotonic()
            for _ in range(WARM_UP_ITERATIONS):
                self._iterate()
                self._selection.judge()
            self._wait()
            self.warm_up, self._untimed = time.monotonic() - begun, self.steps

    def _ended(self) -> bool:
        return self.steps >= self.config.total_timesteps or not self._running()

    def _running(self) -> list[int]:
        return [number for number, member in enumerate(self.members) if not member.solved]

    def _iterate(self) -> None:
        self.ppo.slow_down(max(0.0, 1 - self.steps / self.config.total_timesteps))
        self.ppo.collect()
        self.ppo.update()
        self._iterations += 1

    def _wait(self) -> None:
        if self.ppo.device.type == "cuda":
            torch.cuda.synchronize()

    def _report(self) -> None:
        """Judge all members; a solved one has ended, though its batch goes on."""
        found = self._selection.judge()
        rate = round(self.timed_steps / len(self.members) / max(self.seconds, 1e-9))
        for number in self._running():
            member = self.members[number]
            member.note({"steps": self.steps, "seconds": round(self.seconds, 3), "steps_per_s": rate,
                         **found[number]})
            if member.solved:
                self._keep(number)

    def _keep(self, number: int) -> None:
        self.members[number].weights = self.ppo.network.member(number)


class _Selection:
    """`rans.fast.learn.selection.Selection` for all members at once.

    Args:
        ppo: the members in training.
        tasks: theirs.
    """

    def __init__(self, ppo: BatchedPPO, tasks: Sequence[Task]) -> None:
        self._network, self._members, judged = ppo.network, len(tasks), [task.parts() for task in tasks]
        engine = ppo.engine
        self._engines = {
            name: MembersEngine(engine.craft, [each[name].for_evaluation() for each in judged], EPISODES,
                                engine.timing, seed=SELECTION_SEED, device=engine.device)
            for name in judged[0]}
        self._act = fused(_likeliest_action, engine.device)
        self._flight = graphed(self._fly, engine.device)

    def judge(self) -> list[dict[str, float]]:
        """Per member, success and errors as `Selection.judge` and the mean share of open thrusters."""
        return [self._named(values) for values in self._flight().tolist()]

    def _named(self, values: Sequence[float]) -> dict[str, float]:
        left, duties, shares, errors = iter(values), [], [], {}
        for name, engine in self._engines.items():
            prefix = f"{name}/" if len(self._engines) > 1 else ""
            duties.append(next(left))
            shares.append(next(left))
            errors |= {f"error/{prefix}{quantity}": next(left) for quantity in engine.errors()}
        return {"success": min(shares), "duty": fmean(duties), **errors}

    def _fly(self) -> Tensor:
        act = lambda observation: self._act(self._network, observation)  # noqa: E731
        flights = [judged_flight(engine, act, self._members) for engine in self._engines.values()]
        return torch.cat(flights, dim=1)


@torch.no_grad()
def _likeliest_action(network: Network, observation: Tensor) -> Tensor:
    return network.evaluate(observation).mode()
