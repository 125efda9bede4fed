"""Does a node keep its rate, and do valves shut when either side is killed?

``python -m campaigns robots`` flies the shipped agent for ten minutes at 10 Hz against the twin, two
processes over loopback, gives the bag to the agent again, then kills the node or the twin 100 times at random
moments. An agent decides every 0.2 s; for the rate alone its contract is
changed to 0.1 s. On a machine that does other work run it as ``chrt -f 20 python -m ...``: as a robot does.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rans_robot.bus import BusName, open_bus
from rans_robot.messages import FLOATS, unpack
from rans_robot.node import fly_over, replay_bag
from rans_robot.pilot import Plan, export_for_flight
from rans_robot.twin import VALVES_TOPIC, TwinPlan, run_twin

from rans.files import read_json, write_json
from rans.model.spacecraft_file import load_spacecraft
from rans.pretrained import pretrained_folder
from rans.registry import trust_files

AGENT = "go-to-pose-2d"
CRAFT = "floating-platform"
PERIOD = 0.1
"""s: 10 Hz."""
MOST_COMPUTATION = 2e-3
"""s within which 99 of 100 decisions must be made."""
SHUT_WITHIN = 0.6
"""s within which valves must be shut once a side is killed: two and a half periods of the twin's watchdog, or the
age of 0.1 s above the contract's oldest reading, and a period of the monitor's."""
_FIRST_DOMAIN = 60
_PROCESSES = multiprocessing.get_context("fork")
"""What is imported is there at once."""


@dataclass(frozen=True)
class Loop:
    """A long flight."""

    seconds: float
    decisions: int
    missed: int
    computation_median: float
    computation_99: float
    computation_largest: float
    processor_99: float
    latest: float
    replayed: int
    """Commands that came out of the bag the same."""
    fault: str

    @property
    def passed(self) -> bool:
        """Whether it kept its rate and its bag."""
        return (
            not self.fault
            and self.missed == 0
            and self.computation_99 <= MOST_COMPUTATION
            and self.replayed == self.decisions
        )


@dataclass(frozen=True)
class Kill:
    """One side that was killed."""

    side: str
    after: float
    """s of flight."""
    shut: float | None
    """s from the kill until the valves were shut for good; None: they were not."""
    were_open: bool
    """Whether a valve was open when it happened."""

    @property
    def passed(self) -> bool:
        """Whether the valves were shut in time."""
        return self.shut is not None and self.shut <= SHUT_WITHIN


def agent_at(folder: Path, period: float) -> Path:
    """The shipped agent as a node flies it, its contract changed to another control period."""
    export_for_flight(pretrained_folder(AGENT), folder)
    about = read_json(folder / "contract.json")
    about["control_period"] = period
    about["readings"]["oldest"] = 2.0 * period
    write_json(folder / "contract.json", about)
    return folder


def planned(folder: Path) -> Plan:
    """Flight of the agent to the origin."""
    about = read_json(folder / "contract.json")
    return Plan(str(folder), {"name": about["task"], "settings": about["settings"]}, wait=30.0)


def _twin(bus_name: BusName, domain: int, start: tuple[float, ...], seconds: float) -> None:
    bus = open_bus(bus_name, domain)
    plan = TwinPlan(load_spacecraft(CRAFT), PERIOD, start=start, seconds=seconds)
    run_twin(bus, plan, lambda _: None)
    bus.close()


def _node(bus_name: BusName, domain: int, folder: Path) -> None:
    bus = open_bus(bus_name, domain)
    fly_over(bus, planned(folder), None, None, lambda _: None)
    bus.close()


def long_flight(folder: Path, bus_name: BusName, seconds: float, bag: Path) -> Loop:
    """Fly in this process against a twin in another one."""
    twin = _PROCESSES.Process(
        target=_twin, args=(bus_name, _FIRST_DOMAIN, (2.0, 1.0, 40.0), seconds + 60.0)
    )
    twin.start()
    bus = open_bus(bus_name, _FIRST_DOMAIN)
    try:
        report = fly_over(bus, planned(folder), bag, seconds, lambda _: None)
    finally:
        bus.close()
        twin.kill()
        twin.join()
    computed = np.array(report.computed)
    return Loop(
        seconds,
        report.decisions,
        report.missed,
        float(np.median(computed)),
        float(np.percentile(computed, 99)),
        float(computed.max()),
        float(np.percentile(report.used, 99)),
        float(np.max(report.late)),
        replay_bag(bag).equal,
        report.fault,
    )


def kill(folder: Path, bus_name: BusName, side: str, after: float, domain: int) -> Kill:
    """Kill a side a time, s, after valves have opened, and watch the valves from a third process's bus.

    Of a killed node the twin's valves are watched, of a killed twin the node's commands.
    """
    topic = VALVES_TOPIC if side == "node" else "commands"
    seen: list[tuple[float, bool]] = []
    monitor = open_bus(bus_name, domain)
    monitor.subscribe(
        topic, FLOATS, lambda data: seen.append((time.monotonic(), any(unpack(FLOATS, data).data)))
    )
    # Far away: it fires most of the time.
    twin = _PROCESSES.Process(target=_twin, args=(bus_name, domain, (4.0, 3.0, 90.0), 60.0))
    node = _PROCESSES.Process(target=_node, args=(bus_name, domain, folder))
    twin.start()
    node.start()
    try:
        deadline = time.monotonic() + 30.0
        while not any(is_open for _, is_open in seen) and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(after)
        were_open = bool(seen) and seen[-1][1]
        victim = node if side == "node" else twin
        assert victim.pid is not None
        os.kill(victim.pid, signal.SIGKILL)
        killed = time.monotonic()
        time.sleep(SHUT_WITHIN + 1.5)
        later = [(moment, is_open) for moment, is_open in seen if moment > killed]
        shut = None
        if later and not later[-1][1]:
            opened = [moment for moment, is_open in later if is_open]
            shut = max(opened, default=killed) - killed
        return Kill(side, after, shut, were_open)
    finally:
        for process in (twin, node):
            process.kill()
            process.join()
        monitor.close()


@dataclass(frozen=True)
class Robots:
    """Fly for long, and kill either side; it fails where the rate was not kept, or valves did not shut."""

    seconds: float = 600.0
    """Length of the flight."""
    kills: int = 100
    """Kills, of the node and of the twin by turns."""
    bus: BusName = "udp"
    """Transport."""

    def measured(self) -> dict[str, Any]:
        """The long flight, and all kills."""
        trust_files()  # the flights are ours, and so is the code beside their bags
        folder = Path(tempfile.mkdtemp())
        try:
            agent = agent_at(folder / "agent", PERIOD)
            loop = long_flight(agent, self.bus, self.seconds, folder / "flight.mcap")
            random = np.random.default_rng(0)
            kills = [
                kill(
                    agent,
                    self.bus,
                    ("node", "twin")[k % 2],
                    float(random.uniform(0.0, 2.0)),
                    _FIRST_DOMAIN + 1 + k % 8,
                )
                for k in range(self.kills)
            ]
        finally:
            shutil.rmtree(folder)
        return {"loop": asdict(loop), "kills": [asdict(one) for one in kills]}

    def failed(self, evidence: Any) -> bool:
        """Whether the rate was not kept, or valves did not shut."""
        kills = [Kill(**one) for one in evidence["kills"]]
        return not (Loop(**evidence["loop"]).passed and all(one.passed for one in kills))


def in_words(evidence: Any) -> tuple[tuple[str, str], list[tuple[str, str]]]:
    """Headings and rows of the loop."""
    return ("quantity", "value"), _rows(Loop(**evidence["loop"]))


def sides(evidence: Any) -> Iterator[tuple[str, ...]]:
    """Rows of the kills of either side."""
    kills = [Kill(**one) for one in evidence["kills"]]
    for side in ("node", "twin"):
        if own := [one for one in kills if one.side == side]:
            yield _side(own)


def _rows(loop: Loop) -> list[tuple[str, str]]:
    return [
        ("control periods", f"{loop.decisions:,}"),
        ("missed", str(loop.missed)),
        ("computation, median", f"{loop.computation_median * 1e3:.2f} ms"),
        ("computation, 99 % below", f"{loop.computation_99 * 1e3:.2f} ms"),
        ("computation, largest", f"{loop.computation_largest * 1e3:.2f} ms"),
        ("of the processor's time, 99 % below", f"{loop.processor_99 * 1e3:.2f} ms"),
        ("begun late by at most", f"{loop.latest * 1e3:.2f} ms"),
        ("commands equal in the replay", f"{loop.replayed:,}"),
    ]


def _side(kills: list[Kill]) -> tuple[str, ...]:
    times: list[Any] = [one.shut for one in kills if one.shut is not None]
    return (
        kills[0].side,
        str(len(kills)),
        str(sum(one.were_open for one in kills)),
        str(sum(one.passed for one in kills)),
        f"{max(times, default=float('nan')):.2f}",
    )
