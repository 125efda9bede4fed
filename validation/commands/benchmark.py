"""``rans benchmark``: speed on this machine, compared with its memory bandwidth."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from rans.api.names import load_spacecraft
from rans.base.errors import ConfigError
from rans.base.files import command_line, environment, ready_folder, write_json, writing_at_end
from rans.base.table import Table
from rans.base.terminal import Terminal
from rans.cli.door import Options, command_of, word
from validation.functions import benchmark

if TYPE_CHECKING:
    from validation.speed.measurement import Measurement


@command_of(
    benchmark,
    without=("task", "device", "num_envs"),
    spacecraft=word("[SPACECRAFT...]", tuple[str, ...]),
)
class Benchmark(Options):
    """Measure the speed of engine, trainer, optimizer and agents on this machine.

    Compile time is reported separately. Figures repeat on an idle machine only. Ctrl-C keeps what was
    measured.
    """

    group = "Check"
    guide = "docs/speed.md"
    examples = ("rans benchmark --quick",)
    following = ("rans train go-to-pose",)

    output: Annotated[Path | None, arg(metavar="FILE")] = None
    """JSON file to write all values to, warm-up times and notes too."""

    def run(self) -> int:
        """Print ratios first, then the measurements; after an interrupt, those so far."""
        from validation.speed.measured import chosen_device

        if self.output is not None:
            if self.output.suffix != ".json":
                raise ConfigError(f"--output must end in .json, got {str(self.output)!r}.")
            ready_folder(self.output.parent)
        device = chosen_device(None, self.quick)
        console = Terminal()
        measured: list[Measurement] = []
        with writing_at_end(lambda: self._show(console, device, measured)):
            self._measure(console, device, measured)
        return 0

    def _measure(self, console: Terminal, device: str, result: list[Measurement]) -> None:
        """Add each measurement to the list as it ends, so that an interrupt keeps what there is."""
        from validation.speed.measured import measured

        crafts = [load_spacecraft(name) for name in self.spacecraft]
        with console.status("measuring ...") as status:
            for measurement in measured(crafts, "go-to-pose", (), device, self.quick):
                result.append(measurement)
                status.update(f"measured {measurement.name}")

    def _show(
        self,
        console: Terminal,
        device: str,
        measured: list[Measurement],
    ) -> None:
        """Print and write the results so far, if there are any; an interrupt ends here too."""
        import torch

        from validation.speed.ratios import bounds

        if not measured:
            return
        ratios = list(bounds(measured))
        name = torch.cuda.get_device_name(device) if device.startswith("cuda") else "CPU"
        about = environment() | {"device": name, "threads": str(torch.get_num_threads())}
        if self.output is not None:
            content = {
                "ratios": [asdict(r) for r in ratios],
                "measurements": [asdict(m) for m in measured],
                "environment": about,
                "command": command_line(),
            }
            write_json(self.output, content)
            console.say(f"Written to {self.output}.")
        # The first column of a table is not broken, and names are long.
        console.table(
            Table(
                ("value", "ratio", "of"),
                [(_digits(r.value), r.name, r.note) for r in ratios],
                _hardware(about),
            )
        )
        columns = ("", "measurement", "value", "unit")
        console.table(Table(columns, [_measured(m) for m in measured]))
        if self.output is None and self.quick:
            console.suggest("rans benchmark --output speed.json")


def _hardware(about: dict[str, str]) -> str:
    return (
        f"{about['device']} ({about['processor']}, {about['cores']} cores, {about['threads']} "
        f"threads), torch {about['torch']}, rans {about['rans']}"
    )


def _measured(m: Measurement) -> tuple[str, ...]:
    value = "-" if m.value is None else _digits(m.value)
    return m.kind, m.name, value, m.unit


def _digits(value: float) -> str:
    """Number with at most four significant digits and no exponent."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    decimals = 3 - math.floor(math.log10(abs(value)))
    text = f"{round(value, decimals):,.{max(0, decimals)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
