"""An export format: the operations of an agent as a text that people read."""

from pathlib import Path
from typing import Any

from rans.extend import Ports, Program, write_text


def write_outline(
    folder: Path, program: Program, ports: Ports, title: str, contract: str, *_: Any
) -> None:
    """Write agent.outline, a line for each operation on rows of numbers, which are ONNX's by name and meaning.

    A program's `constants` are its tables by name; a contract is the JSON text of agent.json.
    """
    lines = [title, f"observation ({ports.observation}) -> command ({ports.command})"]
    for step in program.steps:
        tables = {
            name: program.constants[name].shape for name in step.inputs if name in program.constants
        }
        lines.append(
            f"{', '.join(step.outputs)} = {step.operation}({', '.join(step.inputs)}) {tables}"
        )
    write_text(folder / "agent.outline", "\n".join(lines) + "\n")
