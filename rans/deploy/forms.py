"""Forms of exported agents by name: those of the core, and those that installed packages add."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, get_args

from rans.registry import Registry

if TYPE_CHECKING:
    from rans.deploy.program import Ports
    from rans.policy.program import Program

Form = Literal["sb3", "rans", "onnx", "numpy", "c", "c8"]
"""Forms of the core; `forms` has those of packages too."""


class ProgramWriter(Protocol):
    """Writes an agent in a form, into the file agent.FORM; see `rans.deploy.c.files.write_c` for the arguments."""

    def __call__(
        self,
        folder: Path,
        program: Program,
        ports: Ports,
        title: str,
        contract: str,
        pairs: Mapping[str, Any] | None = ...,
    ) -> None:
        """Write the program of an agent."""
        ...


FORMATS: Registry[ProgramWriter] = Registry(
    kind="export format",
    group="rans.export_formats",
    built_in={},
    checked=lambda write: write,
)
"""Forms that installed packages add."""


def forms() -> tuple[str, ...]:
    """Names of all forms, those of packages that are not installed too."""
    return tuple(dict.fromkeys((*get_args(Form), *FORMATS)))
