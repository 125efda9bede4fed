"""Formats of exported agents by name: those printed from an agent's program, also by packages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from rans.base.registry import Registry

if TYPE_CHECKING:
    from rans.deploy.program import Ports
    from rans.policy.network import Network
    from rans.policy.program import Program


class ProgramWriter(Protocol):
    """Writes an agent in a form, into the file agent.FORM or those of its `Format`."""

    def __call__(
        self,
        folder: Path,
        program: Program,
        ports: Ports,
        title: str,
        contract: str,
        pairs: Mapping[str, Any] | None = ...,
    ) -> None:
        """Write the program of an agent, with a title, its contract and golden pairs (`rans.deploy.contract`)."""
        ...


class Format(NamedTuple):
    """A form of exported agents: what writes it, and what differs from other forms."""

    write: Callable[..., None]
    """A `ProgramWriter`."""
    files: tuple[str, ...] = ()
    """Names of its files that do not end in .FORM."""
    reduced: Callable[[Network], Network] | None = None
    """What makes the network that is exported of an agent's; golden pairs are of that one. None: its own."""
    is_prefixed: bool = False
    """Whether it takes ``prefix``, which begins the public names in its files."""
    check: Callable[[Path], str] | None = None
    """What checks the files in a folder, and says the result as a sentence."""


FORMATS: Registry[Format] = Registry(
    kind="export format",
    group="rans.export_formats",
    built_in={
        "onnx": "rans.deploy.onnx_file:write_onnx",
        "numpy": "rans.deploy.numpy_file:NUMPY_FILES",
    },
    checked=lambda found: found if isinstance(found, Format) else Format(found),
)
"""Formats by name, of a `Format` or a `ProgramWriter`."""
