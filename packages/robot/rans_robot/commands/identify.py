"""``rans identify``: a spacecraft and its conditions from logs of its flights, and flights for it."""

from __future__ import annotations

import shlex
from pathlib import Path

from rans.extend import ConfigError, Options, Table, Terminal, command_of, doing, word
from rans_robot.functions import identify


@command_of(
    identify,
    without=("window",),
    defaults={"spacecraft": ""},
    logs=word("LOG...", tuple[Path, ...]),
)
class Identify(Options):
    """Identify forces, inertia, centre of mass, delays and disturbances from logs of flights.

    Motion determines forces and inertia only in proportion to the mass, so weigh the spacecraft first. Writes
    spacecraft.toml, conditions.toml with the intervals, and identified.json. With --excite it writes an agent that
    flies the most informative commands, instead.
    """

    group = "Deploy"
    guide = "docs/robot/identify.md"
    examples = ("rans identify flight.csv --spacecraft floating-platform",)

    excite: str = ""
    """Instead of reading logs, write an agent that flies the most informative commands about this spacecraft (name
    or TOML file) for a minute, by `rans fly`. They keep it in a box of 3 m round the goal of the flight, or
    of another side (m), as in `--excite mine.toml,box=2`."""
    output: Path | None = None
    """Folder of the results; by default identified, or excitation with --excite."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return (shlex.join(["rans", "validate", str(self._folder / "spacecraft.toml"), "--quick"]),)

    @property
    def _folder(self) -> Path:
        """Folder of the results."""
        return self.output or Path("excitation" if self.excite else "identified")

    def run(self) -> int:
        """Print what was identified and what the logs do not determine."""
        from rans_robot.identify.result import UNITS

        if self.excite:
            return self._excite()
        if not self.logs:
            raise ConfigError("name at least one log, a bag (.mcap) or a CSV file.")
        if not self.spacecraft:
            raise ConfigError("name the data sheet with --spacecraft, a name or a TOML file.")
        console = Terminal()
        with doing("identifying: the flights are predicted for every candidate"):
            result = identify(self.logs, self.spacecraft, self.robot, namespace=self.namespace)

        rows = [
            (
                f"{row.name}, {row.unit}",
                f"{row.nominal:.4g}",
                f"{row.value:.4g}",
                f"{row.low:.4g} to {row.high:.4g}" if row.is_identifiable else "not identifiable",
            )
            for row in result.rows()
        ]
        console.table(Table(("quantity", "data sheet", "value", "95 %"), rows, "Identified"))
        # How much better the identified craft predicts the same logs.
        predictions = [
            [channel.name, f"{channel.before:.4g}", f"{channel.after:.4g}", UNITS[channel.name]]
            for channel in result.channels()
        ]
        title = f"Error of predictions over {result.fit.window:g} s, rms"
        columns = ("reading", "data sheet", "identified", "unit")
        console.table(Table(columns, predictions, title))
        console.say(
            f"The force follows a command {1e3 * result.delay:.1f} ms later in the mean (95 %: "
            f"+-{1.96e3 * result.delay_deviation:.1f} ms)."
        )
        for sentence in result.notes():
            console.say(sentence)
        folder = result.write(self._folder)
        console.say(f"Written to {folder}. Train for it:")
        spacecraft = ["--spacecraft", str(folder / "spacecraft.toml")]
        conditions = ["--conditions", str(folder / "conditions.toml")]
        console.command(shlex.join(["rans", "train", "go-to-pose", *spacecraft, *conditions]))
        return 0

    def _excite(self) -> int:
        """Write a folder of commands, and say how to fly them and then to identify; the exit code is 0."""
        from rans_robot.functions import excite

        if self.logs or self.spacecraft:
            raise ConfigError(
                "--excite reads no logs and takes the spacecraft itself: leave out both."
            )
        craft, comma, text = self.excite.rpartition(",box=")
        craft, side = (craft, text) if comma else (self.excite, "3")
        try:
            box = float(side)
        except ValueError:
            raise ConfigError(f"--excite CRAFT,box=SIDE takes a side in m, got {side!r}.") from None
        folder = excite(craft, self._folder, box)
        console = Terminal()
        console.say(
            f"Written to {folder}: 60 s of commands that keep {craft} in a box of {box:g} m. Fly them "
            "from the middle of the box, and identify the spacecraft from the bag:"
        )
        console.command(shlex.join(["rans", "fly", str(folder), "--seconds", "60"]))
        console.command(f"rans identify FLIGHT.mcap --spacecraft {shlex.quote(craft)}")
        return 0
