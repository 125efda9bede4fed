"""What `rans validate` and `rans benchmark` do, as functions of `rans`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rans.api.judging import CRAFT, ConditionsLike, SpacecraftLike
from rans.api.names import load_conditions, load_spacecraft
from rans.base.settled import settled_alone

if TYPE_CHECKING:
    from validation.speed.measurement import Measurement
    from validation.speed.ratios import Ratio
    from validation.study.checks import Study


@settled_alone
def validate(
    spacecraft: SpacecraftLike = CRAFT,
    *,
    quick: bool = False,
    layer: str | None = None,
    conditions: ConditionsLike | None = None,
    seed: int = 0,
) -> Study:
    """Check a spacecraft's motion against Drake and the laws of mechanics, layer by layer.

    >>> found = rans.validate("floating-platform", quick=True, layer="thrusters")
    >>> found.passed, len(found.checks)
    (True, 2)

    Args:
        spacecraft: name of a spacecraft that comes with RANS, or your own TOML file.
        quick: whether to use fewer states and flights and no compiler: about 15 s instead of some minutes.
        layer: check this layer only: thrusters, commands, accelerations, period, flights, engine, onsets,
            ...; by default all.
        conditions: check under these conditions too, each effect alone and all together: a name (see `rans list
            CONDITIONS`) or your own TOML file.
        seed: random seed of states and commands.

    Raises:
        ConfigError: Drake refuses the mass properties, or one of these does not exist.
    """
    from rans.show.progress import watched
    from validation.study.study import study

    craft = load_spacecraft(spacecraft)
    met = None if conditions is None else load_conditions(conditions, craft)
    with watched() as stage:
        return study(craft, seed, quick, layer, stage, met)


@dataclass(frozen=True)
class Speed:
    """Speeds measured on this machine."""

    device: str
    measurements: list[Measurement]
    ratios: list[Ratio]
    """Measured speeds as shares of the bound that the memory bandwidth sets."""

    def __repr__(self) -> str:
        sentence = "; ".join(
            f"{measurement.kind}, {measurement.name}: {measurement.value:,.4g} {measurement.unit}"
            for measurement in self.measurements
            if measurement.value is not None
        )
        return f"<Speed on {self.device}: {sentence}>"

    def __getitem__(self, name: str) -> Measurement:
        return {measurement.name: measurement for measurement in self.measurements}[name]


@settled_alone
def benchmark(
    spacecraft: SpacecraftLike | Sequence[SpacecraftLike] = ("floating-platform", "free-flyer"),
    task: str = "go-to-pose",
    *,
    device: str | None = None,
    num_envs: int | Sequence[int] = (),
    quick: bool = False,
) -> Speed:
    """Measure the speed of engine, trainer, optimizer and agents on this machine.

    >>> found = rans.benchmark("floating-platform", num_envs=[16], quick=True)
    >>> len(found.measurements) > 3
    True

    Args:
        spacecraft: names of spacecraft that come with RANS, or your own TOML files.
        task: task to step and to train.
        device: cpu or cuda; by default a GPU if there is one.
        num_envs: batch size, or several; by default the usual ones for the device.
        quick: whether to measure rough figures in seconds: one small batch, few repeats, nothing compiled on a CPU.

    Raises:
        ConfigError: there is no such spacecraft, task or device, or the compiler is missing.
    """
    from rans.show.progress import watched
    from validation.speed.measured import chosen_device, measured
    from validation.speed.ratios import bounds

    device = chosen_device(device, quick)
    several = isinstance(spacecraft, Sequence) and not isinstance(spacecraft, str)
    crafts: Any = spacecraft if several else [spacecraft]
    sizes = [num_envs] if isinstance(num_envs, int) else num_envs
    results: list[Measurement] = []
    with watched() as stage:
        step = stage("measuring", None)
        for measurement in measured(map(load_spacecraft, crafts), task, sizes, device, quick):
            results.append(measurement)
            step(1)
    return Speed(device, results, list(bounds(results)))
