"""``rans export``: an agent as files for other software."""

from __future__ import annotations

import shlex
from typing import Annotated

from tyro.conf import arg

from rans.api.pages import export, exported
from rans.base.terminal import Terminal, doing
from rans.cli.door import Options, command_of, word


@command_of(export, agent=word("RUN"), format=Annotated[str, arg(metavar="FORM")])
class Export(Options):
    """Export an agent for other software, with an interface contract, test vectors and a model card.

    rans is a folder that works as a run folder, without the critic. onnx is one file for any ONNX runtime. numpy
    is a Python file and its tables. c is a header and a source in C99, without allocation or dependencies; it
    is compiled and checked if there is a compiler. fmu is a unit of FMI 2.0 for co-simulation, as Simulink and
    Dymola read it.
    """

    group = "Deploy"
    guide = "docs/export.md"
    examples = (
        "rans export runs/my-agent --output my-agent --format onnx",
        "rans export pretrained:go-to-pose-2d --output my-agent --format numpy",
    )
    following = ("rans view {agent}",)

    def run(self) -> int:
        """Write the export and print its files and what to run next; the exit code is 0."""
        from rans.deploy.forms import FORMATS
        from rans.evaluation.fly.contestant_name import ContestantName
        from rans.evaluation.fly.contestants import contestant
        from rans.fast.learn.run_folder import solved_percent

        with doing(f"flying {self.agent} for its contract and its card"):
            output, card = exported(
                self.agent, self.output, self.format, self.episodes, self.force, self.name
            )
        name = ContestantName.parse(self.agent)
        size = sum(file.stat().st_size for file in output.iterdir() if file.is_file())
        Terminal().say(f"{output} has the agent, its contract and its card, {size / 1000:.0f} kB.")
        if "evaluation" in card:
            percent = solved_percent(card)
            text = f"{percent:.4g} % of {card['episodes']:,} flights are solved."
            own = "" if name.kind == "policy" else name.shortfall(percent, contestant(name))
            Terminal().say(own or text)
        if self.format == "numpy":
            Terminal().suggest(f"cd {shlex.quote(str(output))} && python agent.py")
        elif self.format == "onnx":
            Terminal().suggest(shlex.join(["rans", "evaluate", str(output)]))
        if self.format in FORMATS and (check := FORMATS[self.format].check):
            Terminal().say(check(output))
        if card["episodes"] != self.episodes:
            Terminal().say(f"The card keeps its metrics from {card['episodes']:,} flights.")
        return 0
