"""Random closed loops whose simulation must lie inside the sets of the checker of trapping sets.

Nothing here is RANS's but the writer of the agent's file, which the checker reads: the network is a few products of
NumPy, the motion an integration by SciPy of the rigid body in the world frame, at 33 instants of a control period.
`violations` says where the checker is unsound, and how much larger its sets are than what the simulation reaches.
"""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np
import torch
from rans_proof.trap_certificate import TrapCertificate
from scipy.integrate import solve_ivp

from rans.fast.agent_files.agent import actor_bytes
from rans.policy.architecture import Architecture
from rans.tasks.derived import layout
from rans.tasks.tracking import TrackVelocity

_DIRECTIONS = [(3, 4), (4, 3), (5, 12), (12, 5), (8, 15), (1, 0), (0, 1)]
"""Of whole length, so that torques of thrusters can be equal without rounding."""
_WORK = 5 * 13 * 17
_INSTANTS = 33
"""Instants of a period at which the speed is looked at."""
_STATES = 24
"""States of each cell that fly a period; a third of the coordinates are on its edges."""
_READINGS = 600
"""Readings of each cell, whose commands are computed."""
_ROUNDING = 1e-7
"""By which an integrated coordinate may be beyond an edge, in cells: tolerances of SciPy are 1e-10."""


@dataclass(frozen=True)
class Case:
    """A random craft, network and grid."""

    craft: dict[str, Any]
    tensors: dict[str, torch.Tensor]
    table: TrapCertificate
    period: float
    force: np.ndarray
    """(n, 2) N."""
    lever: np.ndarray
    """(n,) of -1, 0 and 1."""
    torque: float
    """N m."""

    def loop(self, module: ModuleType) -> Any:
        """The closed loop as a checker, perhaps with a planted error, has it."""
        architecture = Architecture(layout(TrackVelocity(), 2), len(self.lever), (6, 6))
        files = {
            "agent.safetensors": actor_bytes(architecture, self.tensors, 1),
            "config.json": json.dumps(
                {"task": "track-velocity", "timing": {"control_period": self.period}}
            ).encode(),
            "spacecraft.toml": _toml(self.craft).encode(),
        }
        module.ctx.prec = 64
        return module._Loop(self.table._asdict(), files)

    @property
    def step(self) -> float:
        """Change of spin by a thruster in a period, rad/s."""
        return self.torque * self.period / self.craft["inertia"]

    def log_odds(self, states: np.ndarray) -> np.ndarray:
        """Log-odds (N, n) of readings (N, 3) of velocity in B and spin."""
        t = {name: x.double().numpy() for name, x in self.tensors.items()}
        vx, vy, w = states.T
        nothing = np.zeros_like(w)
        x = np.stack((vx, vy, w, nothing + 2.0, -vx, -vy, nothing, nothing), axis=1)
        deviation = np.sqrt(t["features_extractor.variance"] + 1e-6)
        x = (x - t["features_extractor.mean"]) / deviation
        for k in (0, 2):
            x = np.tanh(
                np.einsum("oi,ni->no", t[f"features_extractor.trunk.{k}.weight"], x)
                + t[f"features_extractor.trunk.{k}.bias"]
            )
        out = np.einsum("oi,ni->no", t["action_net.weight"], x) + t["action_net.bias"]
        return out[:, 1::2] - out[:, ::2]

    def flown(
        self, states: np.ndarray, commands: np.ndarray, factor: np.ndarray, time: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Speeds (N, instants), and states (N, 3) in B after a time (s, also below 0)."""
        count = len(states)
        pull = commands @ self.force / self.craft["mass"] * factor[:, None]
        rate = commands @ self.lever * self.torque / self.craft["inertia"] * factor

        def rates(_: float, y: np.ndarray) -> np.ndarray:
            angle, spin = y.reshape(4, count)[2:]
            c, s = np.cos(angle), np.sin(angle)
            ax = c * pull[:, 0] - s * pull[:, 1]
            ay = s * pull[:, 0] + c * pull[:, 1]
            return np.concatenate((ax, ay, spin, rate))

        begin = np.concatenate((states[:, 0], states[:, 1], np.zeros(count), states[:, 2]))
        instants = np.linspace(0.0, time, _INSTANTS)
        path = solve_ivp(rates, (0.0, time), begin, "DOP853", instants, rtol=1e-10, atol=1e-12).y
        vx, vy, angle, spin = path.reshape(4, count, _INSTANTS)
        c, s = np.cos(angle[:, -1]), np.sin(angle[:, -1])
        end = (c * vx[:, -1] + s * vy[:, -1], c * vy[:, -1] - s * vx[:, -1], spin[:, -1])
        return np.hypot(vx, vy), np.stack(end, axis=1)


@dataclass
class Findings:
    """What a comparison of a checker with simulation found."""

    broken: list[str]
    """Where the simulation leaves the checker's sets."""
    rings: list[float]
    """Largest ring of an image over the one that is reached, with one cell of room."""
    turns: list[float]
    """Sectors of an image over those that are reached, with two cells of room."""
    speeds: list[float]
    """Bound of the speed over the highest speed."""
    commands: list[float]
    """Commands that a cell may have, over those of its states."""


def random_case(seed: int) -> Case:
    """A random craft of 3 or 4 thrusters, network of two layers, and grid."""
    random = np.random.default_rng(seed)
    thrusters, lever, force = [], [], []
    count = int(random.integers(3, 5))
    for k in range(count):
        x, y = _DIRECTIONS[random.integers(len(_DIRECTIONS))]
        x, y = x * int(random.choice([-1, 1])), y * int(random.choice([-1, 1]))
        length = math.hypot(x, y)
        arm, along = 2.0 ** -int(random.integers(3)), int(random.integers(-8, 9)) / 16
        sign = int(random.choice([-1, 1])) if k else 1  # one at least turns the craft
        turns = k < 2 or random.random() < 0.7
        size = _WORK / length / arm / 1024.0
        position = [
            along * x + turns * sign * arm * y / 64,
            along * y - turns * sign * arm * x / 64,
        ]
        thrusters.append({"position": position, "direction": [x, y], "force": size})
        force.append((size * x / length, size * y / length))
        lever.append(sign * turns)
    if seed % 4 < 2:  # a pair of opposite forces, which coasts if both are open
        first = thrusters[0]
        pair = [-c for c in first["direction"]]
        part = 0.5 if seed % 4 == 1 else 1.0  # or that does not, as its forces differ
        other = [-c / part for c in first["position"]]
        thrusters[1] = {"position": other, "direction": pair, "force": part * first["force"]}
        force[1] = (-part * force[0][0], -part * force[0][1])
        lever[1] = lever[0]
    torque = _WORK / 1024.0 / 64
    # A period turns by up to a radian, and a pulse is a third of the limit of the speed.
    period = float(np.round(random.uniform(0.2, 0.6), 3))
    strongest = np.linalg.norm(force, axis=1).max()
    craft = {
        "mass": float(strongest * period / random.uniform(0.03, 0.06)),
        "inertia": float(torque * period / random.uniform(0.1, 0.5)),
        "thruster": thrusters,
    }

    # Readings of a typical size make log-odds of some units, of either sign.
    def table(*shape: int) -> torch.Tensor:
        return torch.tensor(random.normal(size=shape), dtype=torch.float32)

    mean = 0.05 * random.normal(size=8)
    mean[3] = 2.0 + 0.02 * random.normal()
    variance = np.array([0.003, 0.004, 0.5, 0.0, 0.003, 0.005, 0.0, 0.0]) * random.uniform(0.5, 2.0)
    mean[6:] = 0.001 * random.normal(size=2)
    variance[3] = 1.0
    variance[6:] = 2e-6
    tensors = {
        "features_extractor.mean": torch.tensor(mean, dtype=torch.float32),
        "features_extractor.variance": torch.tensor(variance, dtype=torch.float32),
        "features_extractor.trunk.0.weight": 0.3 * table(6, 8),
        "features_extractor.trunk.0.bias": 0.3 * table(6),
        "features_extractor.trunk.2.weight": 0.5 * table(6, 6),
        "features_extractor.trunk.2.bias": 0.3 * table(6),
        "action_net.weight": 3.0 * table(2 * count, 6),
        "action_net.bias": table(2 * count),
    }
    if seed % 3 == 0:  # nearly linear, where enclosures have no room for an error of a cell's box
        for name in ("trunk.0.weight", "trunk.2.weight", "trunk.0.bias", "trunk.2.bias"):
            tensors[f"features_extractor.{name}"] *= 0.05
        tensors["action_net.weight"] *= 400.0
    # Half of the cases with errors.
    off: dict[str, float] = dict.fromkeys(("mass", "thrust", "velocity", "spin", "delay"), 0.0)
    if seed % 2:
        off |= {"mass": 0.04, "thrust": 0.08, "velocity": 0.002, "spin": 0.02, "delay": 0.02}
    sizes = {"rings": 12, "sectors": 24, "layers": 12, "fine": 4}
    step = torque * period / craft["inertia"]
    spin = sizes["layers"] / sizes["fine"] * step * (1 + off["thrust"]) / (1 - off["mass"])
    keep = {"speed": 0.15, "spin": float(spin * 1.0001)}
    start = {"speed": 0.05, "spin": 0.1}
    certificate = TrapCertificate({}, keep, start, sizes, off, [], "")
    case = Case(craft, tensors, certificate, period, np.array(force), np.array(lever), torque)
    # Each thruster changes its command somewhere among fast states, whose cells are wide.
    angle = random.uniform(-np.pi, np.pi, count)
    fast = keep["speed"] * random.uniform(0.5, 1.0, count)
    spins = spin * random.uniform(-0.5, 0.5, count)
    odds = case.log_odds(np.stack((fast * np.cos(angle), fast * np.sin(angle), spins), axis=1))
    tensors["action_net.bias"][1::2] -= torch.tensor(np.diag(odds), dtype=torch.float32)
    return case


def violations(module: ModuleType, case: Case, cells: int = 24) -> Findings:
    """Compare a checker with the simulation of states of random cells, of late readings, and of outward bends."""
    findings = _cells(module, case, cells)
    findings.broken += _late_readings(module, case) + _bends(module, case)
    return findings


def _late_readings(module: ModuleType, case: Case) -> list[str]:
    """Readings that are further off than the checker takes them to be, when their command acts."""
    loop, off = case.loop(module), case.table.uncertainty
    if not off["delay"]:
        return []
    random = np.random.default_rng(1)
    count = 1500
    high = _factors(off)[1]
    fastest = case.table.grid["layers"] / case.table.grid["fine"] * case.step * high
    angle = random.uniform(-np.pi, np.pi, count)
    speed = case.table.keep["speed"] * random.uniform(0.9, 1.0, count)
    spin = fastest * random.choice([-1.0, 1.0], count)
    read = np.stack((speed * np.cos(angle), speed * np.sin(angle), spin), axis=1)
    every = np.array(list(itertools.product((0, 1), repeat=len(case.lever))))
    commands = every[random.integers(len(every), size=count)]
    _, later = case.flown(read, commands, np.full(count, high), off["delay"])
    moved = np.abs(later - read) + np.array([off["velocity"], off["velocity"], off["spin"]])
    moved = moved[np.hypot(*later[:, :2].T) <= case.table.keep["speed"]]
    bound = np.array([float(x) for x in loop.reading])
    broken = [
        f"a reading is off by {largest}, not {allowed} ({name})"
        for name, largest, allowed in zip(("x", "y", "spin"), moved.max(0), bound, strict=True)
        if largest > allowed * (1 + 1e-9)
    ]
    loose = bound > 2.0 * moved.max(0)
    return broken + [f"readings are taken for {bound}, and are {moved.max(0)}"] * bool(loose.any())


def _bends(module: ModuleType, case: Case) -> list[str]:
    """Images and speeds of cells so small that the checker's bounds have no room to hide an error.

    The velocity bends outward between equal speeds, so that it is fastest within the period.
    """
    grid = {"rings": 1200, "sectors": 2400, "layers": 1200, "fine": 400}
    small = replace(case, table=case.table._replace(grid=grid))
    loop, limit = small.loop(module), case.table.keep["speed"]
    low, high = _factors(case.table.uncertainty)
    findings = Findings([], [], [], [], [])
    for command in itertools.product((0, 1), repeat=len(case.lever)):
        u = np.array([command])
        if not any(command) or np.linalg.norm(u @ case.force) < 1e-9:
            continue
        for layer in (-1200, -600, 600, 1199):
            spin = np.array([(layer + 0.5) / 400 * case.step])
            still = np.array([[0.0, 0.0, spin[0]]])
            # The change of velocity in the frame of the beginning, and the side to which it bends.
            turn = (spin + 0.5 * (u @ case.lever) * case.step) * case.period
            _, end = case.flown(still, u, np.ones(1), case.period)
            change = (
                np.array([[np.cos(turn[0]), -np.sin(turn[0])], [np.sin(turn[0]), np.cos(turn[0])]])
                @ end[0, :2]
            )
            normal = np.array([change[1], -change[0]]) / np.linalg.norm(change) * np.sign(turn[0])
            begin = 0.8 * limit * normal - 0.5 * change
            place = (
                np.hypot(*begin) / limit * grid["rings"],
                np.arctan2(begin[1], begin[0]) / (2.0 * np.pi) % 1.0 * grid["sectors"],
            )
            ring, sector = (int(x) for x in place)
            cell = (ring, ring + 1, sector, sector + 1, layer, layer + 1)
            factor = np.array([low, high])
            speeds, ends = case.flown(
                np.array([[*begin, spin[0] * x] for x in factor]),
                np.concatenate((u, u)),
                factor,
                case.period,
            )
            _compare(small, loop, cell, command, speeds, ends, factor, findings)
    return findings.broken


def _cells(module: ModuleType, case: Case, cells: int) -> Findings:
    """Compare a checker with the simulation of states of random cells."""
    random = np.random.default_rng(len(case.craft["thruster"]))
    loop = case.loop(module)
    grid = case.table.grid
    findings = Findings([], [], [], [], [])
    low, high = _factors(case.table.uncertainty)
    chosen = [_cell(random, grid, number) for number in range(cells)]
    parts = np.concatenate([_points(random, cell, _STATES) for cell in chosen])
    factor = random.choice([low, high, 1.0], len(parts))
    states = _state(case, parts, factor)
    # Readings are off by what `_late_readings` compares with flights.
    error = np.array([float(x) for x in loop.reading])
    jobs = []
    for number, cell in enumerate(chosen):
        # Commands of many states of the cell.
        many = _points(random, cell, _READINGS)
        read = _state(case, many, random.choice([low, high], _READINGS))
        read += error * random.choice([-1.0, 1.0], read.shape)
        seen = {tuple(map(int, command)) for command in case.log_odds(read) > 0}
        listed = loop.commands(cell)
        for command in seen - set(listed):
            findings.broken.append(f"{cell}: the command {command} is not listed")
        findings.commands.append(len(listed) / len(seen))
        # Images under some commands that it may have.
        rows = np.arange(number * _STATES, (number + 1) * _STATES)
        some = {*listed[:: max(1, len(listed) // 3)], *_pairs(case)}
        jobs += [(cell, command, rows) for command in some]
    commands = np.concatenate([np.tile(command, (_STATES, 1)) for _, command, _ in jobs])
    rows = np.concatenate([rows for *_, rows in jobs])
    speeds, ends = case.flown(states[rows], commands, factor[rows], case.period)
    for number, (cell, command, _) in enumerate(jobs):
        part = slice(number * _STATES, (number + 1) * _STATES)
        _compare(case, loop, cell, command, speeds[part], ends[part], factor[rows][part], findings)
    return findings


def _compare(
    case: Case,
    loop: Any,
    cell: Any,
    command: tuple[int, ...],
    speeds: np.ndarray,
    ends: np.ndarray,
    factor: np.ndarray,
    findings: Findings,
) -> None:
    """The image of a cell with what its states become."""
    grid = case.table.grid
    image = loop.image(cell, command)
    where = f"{cell} under {command}"
    limit = case.table.keep["speed"]
    ring = np.hypot(ends[:, 0], ends[:, 1]) / limit * grid["rings"]
    layer = ends[:, 2] / factor / case.step * grid["fine"]
    if (ring < image.rings[0] - _ROUNDING).any() or (ring > image.rings[1] + _ROUNDING).any():
        findings.broken.append(f"{where}: rings {ring.min()} to {ring.max()}, not {image.rings}")
    if (layer < image.layers[0] - 1e-6).any() or (layer > image.layers[1] + 1e-6).any():
        findings.broken.append(f"{where}: layers to {layer.max()}, not {image.layers}")
    first, last = image.sectors
    middle = (first + last) / 2
    sector = np.arctan2(ends[:, 1], ends[:, 0]) / (2.0 * np.pi) * grid["sectors"]
    off = (sector - middle + grid["sectors"] / 2) % grid["sectors"] - grid["sectors"] / 2
    clear = ring > 1e-4  # a direction of no velocity is none
    if (np.abs(off[clear]) > (last - first) / 2 + 1e-5).any():
        findings.broken.append(
            f"{where}: sectors {sector.min()} to {sector.max()}, not {image.sectors}"
        )
    highest = float(speeds.max())
    bound = limit * cell[1] / grid["rings"] if image.fastest is None else float(image.fastest)
    if highest > bound * (1 + 1e-9):
        findings.broken.append(f"{where}: the speed is {highest}, not {bound}")
    findings.speeds.append(bound / highest)
    findings.rings.append(image.rings[1] / (ring.max() + 1.0))
    if last - first < grid["sectors"]:
        findings.turns.append((last - first) / (np.ptp(off[clear]) + 2.0))


def _factors(off: dict[str, float]) -> tuple[float, float]:
    """Thrust over mass, as parts of the design's."""
    return (1 - off["thrust"]) / (1 + off["mass"]), (1 + off["thrust"]) / (1 - off["mass"])


def _pairs(case: Case) -> set[tuple[int, ...]]:
    """Commands that open the first two thrusters, which may be a pair, or nothing."""
    count = len(case.lever)
    return {(0,) * count, (1, 1, *(0,) * (count - 2))}


def _cell(random: np.random.Generator, grid: dict[str, int], number: int) -> tuple[int, ...]:
    """A random cell; the first ones hold rest, or are half a circle."""
    kinds = (2, 2, 9), (4, 9, 4), (4, 4, 4)  # long ones, in which one error is not hidden by others
    widths = [int(random.integers(1, most)) for most in kinds[number % 3]]
    ring = 0 if number < 3 else int(random.integers(grid["rings"] - widths[0]))
    widths[1] = grid["sectors"] // 2 if number == 1 else widths[1]
    sector = int(random.integers(grid["sectors"] - widths[1] + 1))
    layer = int(random.integers(-grid["layers"], grid["layers"] - widths[2] + 1))
    begins = ring, sector, layer
    return tuple(x for a, w in zip(begins, widths, strict=True) for x in (a, a + w))


def _points(random: np.random.Generator, cell: tuple[int, ...], count: int) -> np.ndarray:
    """Ring, sector and layer, (count, 3), of states of a cell: its corners first, a third of the rest on edges."""
    part = random.random((count, 3))
    part = np.where(random.random(part.shape) < 1 / 3, np.round(part), part)
    part[:8] = list(itertools.product((0.0, 1.0), repeat=3))
    low, high = np.array(cell[::2]), np.array(cell[1::2])
    return low + part * (high - low)


def _state(case: Case, parts: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """Velocity in B and spin, (N, 3), of rings, sectors and layers."""
    grid = case.table.grid
    speed = parts[:, 0] / grid["rings"] * case.table.keep["speed"]
    angle = parts[:, 1] / grid["sectors"] * 2.0 * np.pi
    spin = parts[:, 2] / grid["fine"] * case.step * factor
    return np.stack((speed * np.cos(angle), speed * np.sin(angle), spin), axis=1)


def _toml(craft: dict[str, Any]) -> str:
    """Text of a craft's file."""
    lines = ["dimension = 2", f"mass = {craft['mass']!r}", f"inertia = {craft['inertia']!r}"]
    for thruster in craft["thruster"]:
        lines.append("[[thruster]]")
        lines += [f"{key} = {value!r}" for key, value in thruster.items()]
    return "\n".join(lines) + "\n"
