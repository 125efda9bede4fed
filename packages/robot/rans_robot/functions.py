"""Identification of a spacecraft from logs of its flights, and the flights to identify it from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rans.extend import ConfigError, Spacecraft, SpacecraftLike, brief, load_spacecraft, positive
from rans.settled import settled_alone

if TYPE_CHECKING:
    from rans_robot.identify.log import FlightLog
    from rans_robot.identify.result import Identification
    from rans_robot.interfaces import RobotName


@settled_alone
def identify(
    logs: str | Path | FlightLog | Sequence[str | Path | FlightLog],
    spacecraft: SpacecraftLike,
    robot: RobotName | None = None,
    window: float | None = None,
    namespace: str = "",
) -> Identification:
    """Identify forces, inertia, centre of mass, delays and disturbances of a spacecraft from logs of its flights.

    Motion determines forces and inertia only in proportion to the mass: the mass of ``spacecraft`` must be right.
    Of a satellite that reaction wheels alone turn it determines moments of inertia and wheels only in proportion to
    one another: the sum of the moments stays that of the file.

    >>> with tempfile.NamedTemporaryFile("w", suffix=".csv") as log:
    ...     print("time,x,y,heading", *(f"u{k}" for k in range(8)), sep=",", file=log)
    ...     for k in range(30):
    ...         print(0.2 * k, 0.01 * k, 0.0, 0.0, *(0,) * 8, sep=",", file=log)
    ...     log.flush()
    ...     found = rans.identify(log.name, "floating-platform")
    >>> found.channels()[0].after < 1e-4
    True

    Args:
        logs: bags (.mcap) of `rans fly` or ROS 2, or folders of ``ros2 bag record``, ULog files (.ulg) of PX4, CSV
            files (`rans_robot.identify.log.read_csv`), folders of InnoCube's telemetry, or logs.
        spacecraft: name, TOML file or `Spacecraft`: the data sheet, from which the fit begins.
        robot: kind of robot whose topics a bag has; None: the bag says it, or "ros".
        window: the log is predicted over windows of this length, s; None: of 5 s, doubled while the model explains
            the readings. Of a satellite without thrusters there are none.
        namespace: name before the topics of the robot in a bag, such as "robot1" for /robot1/pose.

    Raises:
        ConfigError: a log cannot be read or is not of this spacecraft, or the spacecraft has propellant or
            effectors of other kinds.
    """
    from rans_robot.identify.fit import fit
    from rans_robot.identify.log import FlightLog
    from rans_robot.identify.result import Identification

    if window is not None:
        positive("window", window)
    craft = load_spacecraft(spacecraft)
    sources = [logs] if isinstance(logs, str | Path | FlightLog) else list(logs)
    return Identification(
        fit(
            craft,
            [
                source if isinstance(source, FlightLog) else _read(source, craft, robot, namespace)
                for source in sources
            ],
            window,
        )
    )


@settled_alone
def excite(
    spacecraft: SpacecraftLike,
    folder: str | Path,
    box: float = 3.0,
    seconds: float = 60.0,
    period: float = 0.2,
    seed: int = 0,
) -> Path:
    """Write an agent for `rans fly` with the most informative commands about a spacecraft, and return its folder.

    It keeps the spacecraft in a box round the goal of the flight, and shuts all valves when the time is up.

    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sorted(file.name for file in rans.excite("floating-platform", f"{folder}/excitation").iterdir())
    ['agent.npz', 'agent.py', 'contract.json', 'golden.json', 'spacecraft.toml']

    Args:
        spacecraft: name, TOML file or `Spacecraft`: the data sheet.
        folder: new folder.
        box: side of the box, m.
        seconds: length of the flight, s.
        period: control period, s.
        seed: of the random commands among which the best are chosen.

    Raises:
        ConfigError: the spacecraft has wheels, propellant or effectors of other kinds, or the folder exists.
    """
    from rans_robot.excitation import write_excitation

    craft = load_spacecraft(spacecraft)
    return write_excitation(craft, Path(folder), box, seconds, period, seed)


def _read(log: str | Path, craft: Spacecraft, robot: RobotName | None, namespace: str) -> FlightLog:
    from rans_robot.identify.log import read_csv
    from rans_robot.identify.telemetry import is_telemetry, read_telemetry

    file = Path(log)
    if file.suffix == ".csv":
        return read_csv(file, craft)
    if file.is_dir() and is_telemetry(file):
        return read_telemetry(file, craft)
    if file.suffix == ".mcap" or file.is_dir():
        from rans_robot.logs import read_bag

        return read_bag(file, craft, robot, namespace)
    if file.suffix in (".ulg", ".ulog"):
        from rans_robot.ulog import read_ulog

        return read_ulog(file, craft)
    raise ConfigError(
        f"a log is a bag (.mcap) or a bag's folder, a ULog (.ulg) or a CSV file (.csv), got {brief(str(file))}."
    )
