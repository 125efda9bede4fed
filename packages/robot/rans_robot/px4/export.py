"""``rans export --format px4``: an agent as a module of PX4, around its C export."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from rans.extend import FORMATS, ConfigError, Ports, Program, write_text, written_columns
from rans_robot.interfaces import PX4_MOTOR_COUNT


def write_px4(
    folder: Path,
    program: Program,
    ports: Ports,
    title: str,
    contract: str,
    pairs: Mapping[str, Any] | None = None,
) -> None:
    """Write the folder agent.px4; see `rans.deploy.forms.ProgramWriter` for the arguments.

    Raises:
        ConfigError: PX4 would stop a motor at an end of a command's range, or has too few motors; its messages do
            not hold what the agent observes; or the disk refuses.
    """
    about = json.loads(contract)
    ranges = about["command"]["ranges"]
    for one in ranges:
        if not 0.0 <= one["low"] < one["high"] <= 1.0:
            raise ConfigError(
                f"PX4 stops a motor below 0 and saturates it above 1, and {one['name']} goes from "
                f"{one['low']:g} to {one['high']:g}. Export the agent as c."
            )
    if len(ranges) > PX4_MOTOR_COUNT:
        raise ConfigError(
            f"PX4 has {PX4_MOTOR_COUNT} motors, and this spacecraft takes {len(ranges)} commands."
        )
    values = {
        "@PERIOD@": f"{about['control_period'] * 1e6:.0f}",
        "@OLDEST@": f"{about['readings']['oldest'] * 1e6:.0f}",
        "@COLUMNS@": ",\n        ".join(f"float({column})" for column in written_columns(about)),
    }
    module = folder / "agent.px4"
    module.mkdir(parents=True, exist_ok=True)
    FORMATS["c"].write(module, program, ports, title, contract, pairs)
    for name in ("rans_agent.cpp", "CMakeLists.txt", "Kconfig"):
        text = (resources.files("rans_robot.px4") / name).read_text("utf-8")
        for mark, value in values.items():
            text = text.replace(mark, value)
        write_text(module / name, text)
