"""``rans benchmark``: speed on this machine, beside what its memory can move."""

from __future__ import annotations

import os
import shutil
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from rans.errors import ConfigError


@dataclass(frozen=True)
class Benchmark:
    """Measure the engine and the trainer; compile time is reported apart."""

    spacecraft: str = "floating-platform"
    """Name of a spacecraft that comes with RANS, or your own TOML file."""
    task: str = "go-to-pose"
    """What it flies."""
    device: str | None = None
    """cpu or cuda; by default a GPU if there is one."""
    num_envs: tuple[int, ...] = ()
    """Sizes of the batch; by default 1,024 to 262,144 on a CPU and 16,384 to 4,194,304 on a GPU."""
    output: Path | None = None
    """JSON file to write the figures to."""

    def run(self) -> int:
        """Print a table of figures."""
        import torch
        from rich.console import Console
        from rich.table import Table

        from rans.fast.trainer import check_device
        from rans.files import environment, write_json
        from rans.spacecraft_file import load_spacecraft
        from rans.tasks import task_class
        from validation.speed import measurements

        device = self.device or ("cuda" if torch.cuda.is_available() else "cpu")
        check_device(device)
        on_gpu = device.startswith("cuda")
        if not on_gpu:
            _check_compiler()
        sizes = list(self.num_envs) or ([16_384, 262_144, 4_194_304] if on_gpu else [1024, 16_384, 262_144])
        about = environment() | {"device": torch.cuda.get_device_name() if on_gpu else "CPU",
                                 "threads": str(torch.get_num_threads())}
        table = Table("measurement", "value", "unit", "warm-up", "note", title=_hardware(about),
                      title_justify="left")
        console, rows = Console(), []
        with console.status("measuring ...") as status:
            for m in measurements(load_spacecraft(self.spacecraft), self.task, task_class(self.task)(),
                                  device, sizes):
                rows.append(asdict(m))
                status.update(f"measured {m.name}")
                table.add_row(m.name, f"{m.value:,.4g}", m.unit, f"{m.warm_up:.1f} s", m.note)
        console.print(table)
        if self.output is not None:
            write_json(self.output, {"environment": about, "measurements": rows})
            print(f"Written to {self.output}.")
        return 0


def _check_compiler() -> None:
    """On a CPU torch compiles the engine with the system's C++ compiler; nothing else here needs one."""
    compiler = os.environ.get("CXX") or ("clang++" if sys.platform == "darwin" else "g++")
    if shutil.which(compiler) is None:
        raise ConfigError(f"the compiled engine needs a C++ compiler, but there is no {compiler} here; "
                          "training works without one, only this measurement does not.")


def _hardware(about: dict[str, str]) -> str:
    return (f"{about['device']} ({about['processor']}, {about['cores']} cores, {about['threads']} "
            f"threads), torch {about['torch']}")


COMMAND = Benchmark
