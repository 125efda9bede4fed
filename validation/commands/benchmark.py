"""``rans benchmark``: speed on this machine, compared with its memory bandwidth and with other packages."""

from __future__ import annotations

import math
from dataclasses import asdict, astuple
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from rans.api.names import load_spacecraft
from rans.cli.door import Options, command_of, word
from rans.errors import ConfigError
from rans.files import command_line, environment, ready_folder, write_json, write_text
from rans.table import Table
from rans.terminal import Terminal, writing_at_end
from validation.functions import benchmark

if TYPE_CHECKING:
    from validation.peers.runner import PeerResult
    from validation.speed.measurement import Measurement
    from validation.speed.ratios import Ratio


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

    peers: bool = False
    """Measure other simulators and trainers too, and say which cannot be measured. Missing ones are installed
    with pip, each into an environment of its own of up to 1.5 GB, in the user's cache (XDG_CACHE_HOME)."""
    output: Annotated[Path | None, arg(metavar="FILE")] = None
    """JSON file to write all values to, warm-up times and notes too, with a figure next to it."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return ("rans train go-to-pose",)

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
        peers: list[tuple[PeerResult, list[Ratio]]] = []
        with writing_at_end(lambda: self._show(console, device, measured, peers)):
            self._measure(console, device, measured)
            self._compare(console, device, peers)
        return 0

    def _measure(self, console: Terminal, device: str, result: list[Measurement]) -> None:
        """Add each measurement to the list as it ends, so that an interrupt keeps what there is."""
        from validation.speed.measured import measured

        crafts = [load_spacecraft(name) for name in self.spacecraft]
        with console.status("measuring ...") as status:
            for measurement in measured(crafts, "go-to-pose", (), device, self.quick):
                result.append(measurement)
                status.update(f"measured {measurement.name}")

    def _compare(
        self, console: Terminal, device: str, result: list[tuple[PeerResult, list[Ratio]]]
    ) -> None:
        """Append to ``result`` peers as they are measured, and ratios to them; an interrupt keeps those."""
        from validation.peers.runner import default_folder
        from validation.speed.ratios import compare_peers
        from validation.speed.suite import effort

        if not self.peers:
            return
        with console.status("measuring peers ...") as status:
            for peer, ratios in compare_peers(
                effort(device, self.quick),
                default_folder(),
                self.quick,
                lambda name: status.update(
                    f"measuring {name}, and ours; it may have to be installed ..."
                ),
            ):
                result.append((peer, ratios))

    def _show(
        self,
        console: Terminal,
        device: str,
        measured: list[Measurement],
        compared: list[tuple[PeerResult, list[Ratio]]],
    ) -> None:
        """Print and write the results so far, if there are any; an interrupt ends here too."""
        import torch

        from validation.peers.unmeasured import UNMEASURED
        from validation.speed.ratios import bounds

        if not measured:
            return
        peers = [peer for peer, _ in compared]
        ratios = [ratio for _, some in compared for ratio in some]
        bound_ratios = list(bounds(measured))
        name = torch.cuda.get_device_name(device) if device.startswith("cuda") else "CPU"
        about = environment() | {"device": name, "threads": str(torch.get_num_threads())}
        # The first column of a table is not broken, and names are long.
        console.table(
            Table(
                ("value", "ratio", "of"),
                [(_digits(r.value), r.name, r.note) for r in (*ratios, *bound_ratios)],
                _hardware(about),
            )
        )
        columns = ("", "measurement", "value", "unit")
        console.table(Table(columns, [_measured(m) for m in measured]))
        if peers:
            columns = ("peer", "version", "environments", "M steps/s", "task", "command")
            console.table(Table(columns, [*map(_peer, peers)]))
            unmeasured = [*map(astuple, UNMEASURED)]
            console.table(Table(("not measured", "why", "tried"), unmeasured))
        if self.output is not None:
            self._write(self.output, about, measured, bound_ratios, peers, ratios)
        elif self.quick:
            console.suggest("rans benchmark --output speed.json")

    def _write(
        self,
        file: Path,
        about: dict[str, str],
        measured: list[Measurement],
        shares: list[Ratio],
        peers: list[PeerResult],
        ratios: list[Ratio],
    ) -> None:
        """Write figures, machine and peers as JSON, with a chart beside it."""
        from rans.show.figures.svg import svg
        from validation.peers.unmeasured import UNMEASURED
        from validation.speed.figure import speed_figure

        content: dict[str, Any] = {
            "ratios": [asdict(r) for r in (*ratios, *shares)],
            "measurements": [asdict(m) for m in measured],
            "peers": [asdict(p) for p in peers],
            "unmeasured": [asdict(u) for u in UNMEASURED] if peers else [],
            "environment": about,
            "command": command_line(),
        }
        write_json(file, content)
        figure = file.with_suffix(".svg")
        write_text(figure, svg(speed_figure(_hardware(about), measured, ratios)))
        Terminal().say(f"Written to {file} and {figure}.")


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


def _peer(p: PeerResult) -> tuple[str, ...]:
    """Row of another simulator or trainer with its M steps/s, or why it was not measured."""
    figures = p.figures
    rate = figures.get("steps_per_s") or figures.get("trained_steps_per_s")
    return (
        p.package,
        figures.get("version", "-"),
        f"{figures['num_envs']:,}" if figures else "-",
        _digits(rate / 1e6) if rate else "-",
        figures.get("task") or p.reason,
        p.command,
    )
