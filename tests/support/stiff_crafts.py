"""Random stiff craft in 25 s of closed loop, beside SciPy's DOP853.

Each craft is drawn, written to a file and read again, flown with the substeps that are chosen for it
(`rans.model.accuracy`), and its commands are integrated once more by `tests.support.pair_oracle`.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from rans.flight import Controller, Flight, fly
from rans.model.accuracy import chosen
from rans.model.actuators import Actuators, OnOff, Pulsed, Throttle
from rans.model.fields import unflatten
from rans.model.spacecraft import Spacecraft, Thruster, controls_every_direction
from rans.model.spacecraft_file import parse_spacecraft, to_toml
from rans.model.timing import Timing
from rans.optimal.control.lqr import LQR
from rans.scenario import scenarios
from rans.tasks import GoToPose
from tests.support.pair_oracle import Oracle
from validation.study.sampling import Restless, gaps

BOUND = 1e-4
"""m and rad within 25 s: a hundredth of what a task notices."""
_SECONDS = 25.0
_PILOTS: dict[str, Callable[[Spacecraft, Timing, int], Controller]] = {
    "LQR": lambda craft, timing, _: LQR(craft, GoToPose(), timing),
    "restless": lambda craft, _, seed: Restless(craft, seed),
    "bang-bang": lambda craft, _, seed: Restless(craft, seed, share=0.0),
}


@dataclass(frozen=True)
class Row:
    """What one craft's flights showed."""

    number: int
    craft: Spacecraft
    timing: Timing
    pilot: str
    warned: str
    """That it is too fast for its control period; empty: nothing was said."""
    spin: float
    """Largest, rad/s."""
    position: float
    """Largest error at any instant, m."""
    attitude: float
    """rad."""

    @property
    def error(self) -> float:
        """The larger of the two; infinite where one is not finite."""
        worst = max(self.position, self.attitude)
        return worst if math.isfinite(worst) else math.inf

    def __str__(self) -> str:
        kind = (
            f"{self.craft.dimension}D {self.craft.actuators.kind:8} {self.craft.thrust_sharing:5}"
        )
        return (
            f"{self.number:4} {kind} {self.timing.control_period:5.3f} s  {self.timing.substeps:2} steps"
            f"  {self.pilot:9} {self.spin:7.2f} rad/s  {self.position:7.1e} m  {self.attitude:7.1e} rad"
            f"{'  too fast' if self.warned else ''}"
        )


def random_craft(seed: int) -> tuple[Spacecraft, float]:
    """A craft that can be controlled, as its file is read, and a control period of 0.05 to 0.5 s."""
    random = np.random.default_rng([seed, 853])
    dimension = 2 if random.random() < 0.3 else 3
    while True:
        with warnings.catch_warnings():  # drawn again where it cannot be controlled
            warnings.simplefilter("ignore", UserWarning)
            craft = _drawn(random, dimension)
            if controls_every_direction(craft):
                return parse_spacecraft(to_toml(craft), "drawn"), _between(random, 0.05, 0.5)


def _drawn(random: np.random.Generator, dimension: Literal[2, 3]) -> Spacecraft:
    flat = np.array([1.0, 1.0, dimension - 2.0])
    moments = np.full(3, 0.0)
    while not 0.0 < moments.max() < moments.sum() - moments.max():
        moments = np.array([_between(random, 0.005, 0.5) for _ in range(3)])
    axes = Rotation.random(rng=random).as_matrix()
    tensor = axes @ np.diag(moments) @ axes.T
    centre = random.uniform(-0.1, 0.1, 3) * flat
    size = _between(random, 0.03, 0.35)
    force = _between(random, 0.2, 4.0)
    nozzles: list[Thruster] = []
    paired = random.random() < 0.5
    for k in range(random.integers(6, 17)):
        if paired and k % 2:
            last = nozzles[-1]
            nozzles.append(Thruster(last.position, _triple(-np.array(last.direction)), last.force))
            continue
        way = random.normal(size=3) * flat
        nozzles.append(
            Thruster(
                _triple(centre + random.uniform(-size, size, 3) * flat),
                _triple(way / np.linalg.norm(way)),
                force * random.uniform(0.5, 1.5),
            )
        )
    kinds: list[Actuators] = [
        OnOff(),
        Throttle(),
        Pulsed(int(random.integers(2, 9)), 1),
        Pulsed(100, 5),
    ]
    return Spacecraft(
        "random",
        dimension,
        _between(random, 1.0, 40.0),
        tuple(map(_triple, (tensor + tensor.T) / 2)),
        tuple(nozzles),
        _triple(centre),
        "split" if random.random() < 0.5 else "none",
        actuators=kinds[random.choice(4, p=[0.5, 0.2, 0.25, 0.05])],
    )


def _between(random: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is evenly distributed."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def _triple(vector: Any) -> tuple[float, float, float]:
    x, y, z = (float(component) for component in vector)
    return (x, y, z)


def row(number: int, flights: int = 1, pilot: str | None = None) -> Row:
    """One craft under one controller, at random one of three."""
    craft, period = random_craft(number)
    left_open = Timing(period, episode_steps=round(_SECONDS / period))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        timing = chosen(craft, left_open)
    name = pilot or list(_PILOTS)[number % 3]
    flight = fly(
        craft,
        GoToPose(),
        _PILOTS[name](craft, timing, number),
        scenarios(GoToPose(), craft, number, flights),
        timing,
    )
    spin = float(np.max(np.linalg.norm(np.array(flight.states.spin()), axis=0)))
    off = gaps(flight.states, integrated(flight))
    return Row(
        number,
        craft,
        timing,
        name,
        str(said[0].message) if said else "",
        spin,
        float(np.max(off["position"])),
        float(np.max(off["attitude"])),
    )


def integrated(flight: Flight) -> Any:
    """The flight's states, (T + 1, N), by the oracle from its starts and commands."""
    rows = [Oracle(flight, None, k).fly() for k in range(flight.commands.shape[1])]
    return unflatten(flight.states, list(np.transpose(rows, (2, 1, 0))))
