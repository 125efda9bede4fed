"""``rans identify``: a spacecraft and its conditions from logs of its flights."""

from __future__ import annotations

import shlex
from pathlib import Path

from rans.extend import ConfigError, Options, Table, Terminal, command_of, doing, ready_folder, word
from rans_robot.functions import identify


@command_of(
    identify,
    without=("window",),
    logs=word("LOG...", tuple[Path, ...]),
)
class Identify(Options):
    """Identify forces, inertia, centre of mass, delays and disturbances from logs of flights.

    Motion determines forces and inertia only in proportion to the mass, so weigh the spacecraft first. Writes
    spacecraft.toml, conditions.toml with the intervals, and identified.json.
    """

    group = "Deploy"
    guide = "docs/robot/identify.md"
    examples = ("rans identify flight.csv --spacecraft floating-platform",)

    output: Path = Path("identified")
    """Folder of the results."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return (shlex.join(["rans", "validate", str(self.output / "spacecraft.toml"), "--quick"]),)

    def run(self) -> int:
        """Print what was identified and what the logs do not determine."""
        from rans_robot.identify.result import UNITS

        if not self.logs:
            raise ConfigError("name at least one log, a bag (.mcap) or a CSV file.")
        console = Terminal()
        ready_folder(self.output)
        with doing("identifying: the flights are predicted for every candidate"):
            result = identify(self.logs, self.spacecraft, self.robot, namespace=self.namespace)
        folder = result.write(self.output)
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
        console.say(f"Written to {folder}. Train for it:")
        spacecraft = ["--spacecraft", str(folder / "spacecraft.toml")]
        conditions = ["--conditions", str(folder / "conditions.toml")]
        console.command(shlex.join(["rans", "train", "go-to-pose", *spacecraft, *conditions]))
        return 0
