"""Seconds of training until solved, against the number of environments: more fly faster and learn less.

Run as ``python -m campaigns.tradeoff``; minutes on a GPU, about five on two CPU cores.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import tyro
from rich.console import Console

from campaigns.command import ended
from rans.errors import ConfigError
from rans.fast.learn.config import PPOSettings, TrainConfig
from rans.fast.learn.recipes import preset
from rans.fast.learn.trainer import check_device
from rans.files import environment, ready_folder, write_json, write_text
from rans.model.spacecraft_file import load_spacecraft
from rans.show.figures.figures import styled
from rans.show.figures.panels import label
from rans.show.figures.plotting import Axes, Figure, FuncFormatter, NullLocator
from rans.show.figures.svg import svg
from rans.show.palette import BLUE, GREY, INK
from validation.speed.training import Success, train_until_solved

_MINIBATCHES = 4
"""Of a rollout, as in the presets."""
_SIZES = (0.125, 0.25, 0.5, 1, 2, 4)
"""Default numbers of environments, times the preset's."""


@dataclass(frozen=True)
class Trained:
    """One training of the study."""

    num_envs: int
    seed: int
    success: Success


@dataclass(frozen=True)
class Tradeoff:
    """Train go-to-pose until solved with growing numbers of environments, all else as in the preset."""

    spacecraft: str = "floating-platform"
    """Or free-flyer."""
    num_envs: tuple[int, ...] = ()
    """Numbers to try; by default from an eighth to four times the preset's."""
    seeds: int = 3
    """Trainings of each number."""
    device: Literal["cuda", "cpu"] = "cpu"
    output: Path = Path("runs/tradeoff.json")
    """What was measured; the figure is beside it, as .svg."""

    def run(self) -> list[Trained]:
        """Print a line a training, and write both files after each.

        Raises:
            ConfigError: a number or the device is wrong, or the disk refused.
        """
        settings = preset("go-to-pose", load_spacecraft(self.spacecraft).dimension, self.device)
        sizes = self.num_envs or tuple(int(share * settings.n_envs) for share in _SIZES)
        if self.seeds < 1:
            raise ConfigError(f"--seeds must be >= 1, got {self.seeds}.")
        if wrong := [count for count in sizes if count < 1 or count % _MINIBATCHES]:
            raise ConfigError(
                f"--num-envs must be multiples of {_MINIBATCHES}, the number of minibatches, "
                f"got {wrong[0]}."
            )
        check_device(self.device)
        ready_folder(self.output.parent)
        trained: list[Trained] = []
        for one in self._train(settings, sizes):
            trained.append(one)
            Console().print(
                f"{one.num_envs:6,} environments, seed {one.seed}: {_said(one.success)}"
            )
            self._write(settings, trained)
        return trained

    def _write(self, settings: PPOSettings, trained: Sequence[Trained]) -> None:
        about = environment()
        write_json(
            self.output,
            {
                "environment": about,
                "settings": asdict(settings),
                "spacecraft": self.spacecraft,
                "device": self.device,
                "trainings": [_row(one) for one in trained],
            },
        )
        hardware = about.get("gpu") if self.device == "cuda" else f"{about['processor']}, one core"
        write_text(
            self.output.with_suffix(".svg"),
            svg(tradeoff_figure(f"go-to-pose, {self.spacecraft}, {hardware}", trained)),
        )

    def _train(self, settings: PPOSettings, sizes: Sequence[int]) -> Iterator[Trained]:
        interval = TrainConfig.report_interval * settings.n_envs
        for count in sizes:
            changed = replace(
                settings, n_envs=count, batch_size=count * settings.n_steps // _MINIBATCHES
            )
            for seed in range(self.seeds):
                # As many steps between reports whatever the number, or large ones would find out late.
                yield Trained(
                    count,
                    seed,
                    train_until_solved(
                        changed, self.device, self.spacecraft, seed, max(1, round(interval / count))
                    ),
                )


def _row(one: Trained) -> dict[str, float | int | bool]:
    return {"num_envs": one.num_envs, "seed": one.seed, **one.success._asdict()}


def _said(success: Success) -> str:
    state = "solved" if success.solved else "not solved"
    return f"{state} after {success.seconds:.2f} s of training, {success.steps / 1e6:.2f} M steps"


@styled
def tradeoff_figure(title: str, trained: Sequence[Trained]) -> Figure:
    """Seconds and steps until solved of every training, open marks if not; a line through the medians."""
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    figure.suptitle(title, fontsize=9, color=INK)
    seconds, steps = figure.subplots(1, 2)
    _against_size(seconds, trained, [one.success.seconds for one in trained])
    label(seconds, "time until solved", "environments", "seconds of training, without warm-up")
    _against_size(steps, trained, [one.success.steps / 1e6 for one in trained])
    label(steps, "experience until solved", "environments", "million steps")
    return figure


def _against_size(axes: Axes, trained: Sequence[Trained], values: Sequence[float]) -> None:
    sizes = sorted({one.num_envs for one in trained})
    medians = [
        statistics.median(v for one, v in zip(trained, values, strict=True) if one.num_envs == size)
        for size in sizes
    ]
    axes.plot(sizes, medians, color=GREY)
    for one, value in zip(trained, values, strict=True):
        axes.plot(
            one.num_envs, value, "o", color=BLUE, fillstyle="full" if one.success.solved else "none"
        )
    axes.set_xscale("log")
    axes.set_xticks(sizes, [f"{size:,}" for size in sizes])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axes.set_ylim(bottom=0.0)


def main() -> int:
    """Run the study; an interrupt loses no training that ended."""
    tyro.cli(Tradeoff).run()
    return 0


if __name__ == "__main__":
    raise SystemExit(ended("tradeoff", main))
