"""Agent files: weights as safetensors with their description as JSON in the header; reading one runs no code.

A training stores its agent in ``agent.safetensors``, an exported agent has that file without its critic.
Files of every release must stay readable (`tests/base/test_pretrained.py`): new keys have
defaults.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.base.errors import ConfigError, NonFiniteState, RansError, brief
from rans.base.files import first_line, plain, read_bytes
from rans.fast.agent_files.tensors import pack_tensors, unpack_tensors
from rans.policy.activations import ACTIVATIONS
from rans.policy.adaptation import ESTIMATORS
from rans.policy.architecture import EXTRACTOR, Architecture
from rans.policy.backbone_registry import BACKBONES
from rans.policy.heads import HEADS
from rans.policy.network import Network
from rans.policy.symmetry import Symmetries
from rans.tasks.observation_terms import Block, Layout, ObservationTerm

AGENT = "agent.safetensors"
"""Name of the file."""
_LARGEST = 2**28
"""Largest number of bytes of an agent file."""
_CRITIC = "value_net.", f"{EXTRACTOR}critic."
"""Prefixes of the names of weights that only training needs."""
_LISTS: dict[str, Callable[[Any], Any]] = {
    "layers": int,
    "averages": float,
    "nominal": float,
    "bounds": float,
    "authority": float,
    "filling": float,
    "frugal": float,
    "reach": float,
    "tokens": lambda row: tuple(map(float, row)),
}


class SavedPolicy(NamedTuple):
    """Content of an agent file."""

    network: Network
    """Network, on the CPU; its critic is zero where the file has none, and training cannot continue."""
    steps: int
    """Environment steps of the training."""


def agent_bytes(architecture: Architecture, tensors: Mapping[str, Tensor], steps: int) -> bytes:
    """Content of an ``agent.safetensors`` with its critic, as trainings write it.

    Keys stay, since later versions read older files, which have the optimizer and its settings too.

    Args:
        architecture: architecture of the network.
        tensors: weights and statistics of the network (`Network.weights`).
        steps: environment steps of the training.
    """
    return pack_tensors(
        {"architecture": _table(architecture), "weights": dict(tensors), "steps": steps}
    )


def actor_bytes(
    architecture: Architecture,
    tensors: Mapping[str, Tensor],
    steps: int,
    at: Mapping[float, Mapping[str, Tensor]] | None = None,
) -> bytes:
    """Content of an ``agent.safetensors``: the actor without its critic.

    Keys stay, since later versions read older files.

    Args:
        architecture: architecture of the network.
        tensors: weights and statistics of the network (`Network.weights`).
        steps: environment steps of the training.
        at: weights at frugalities from 0 to 1 of an agent for any craft (`rans.policy.backbones.AnyCraft.frugal`).

    Raises:
        NonFiniteState: a weight is not finite.
    """
    every = [*tensors.items(), *(entry for own in (at or {}).values() for entry in own.items())]
    for name, x in every:
        if not bool(torch.isfinite(x).all()):
            raise NonFiniteState(
                f"{name} of the agent has numbers that are not finite, so that it is not written: the usual cause "
                "is a training that diverged; use another seed or a smaller learning rate."
            )

    def of_actor(own: Mapping[str, Tensor]) -> dict[str, Tensor]:
        return {name: x for name, x in own.items() if not name.startswith(_CRITIC)}

    further = {"at": {f"{value:g}": of_actor(own) for value, own in at.items()}} if at else {}
    return pack_tensors(
        {
            "architecture": _table(replace(architecture, privileged=0, nominal=())),
            "weights": of_actor(tensors),
            "steps": steps,
        }
        | further
    )


def read_policy(file: Path) -> SavedPolicy:
    """Read an agent from an ``agent.safetensors``; no code in the file is run.

    Raises:
        ConfigError: the file is not an agent, or is damaged.
    """
    return policy_of(read_bytes(file, _LARGEST), file)


def policy_of(content: bytes, where: Path) -> SavedPolicy:
    """Agent of the content of an ``agent.safetensors``; messages name where it is from.

    Raises:
        ConfigError: the content is not an agent, or is damaged.
    """
    with _damage_as_config_error(where):
        return _read(unpack_tensors(content, where))


@contextmanager
def _damage_as_config_error(file: Path) -> Iterator[None]:
    """Context that converts exceptions of a damaged file to a `ConfigError`."""
    try:
        yield
    except RansError:
        raise
    except Exception as error:  # a damaged file may raise anything
        raise ConfigError(f"{file} is damaged: {first_line(error)}.") from error


def _read(table: dict[str, Any]) -> SavedPolicy:
    """Agent from the table of `agent_bytes` or `actor_bytes`; ValueError or KeyError if it is damaged."""
    architecture = _architecture(table["architecture"])
    weights = table["weights"]
    steps = int(table["steps"])
    has_critic = any(name.startswith(_CRITIC) for name in weights)
    network = _network(architecture, weights, has_critic)
    if "at" in table and not has_critic:
        network.at = _further(architecture, table["at"])
    return SavedPolicy(network, steps)


def _further(
    architecture: Architecture, table: Mapping[str, Mapping[str, Tensor]]
) -> dict[float, dict[str, Tensor]]:
    """Weights by name at frugalities from 0 to 1; ValueError if the table is wrong.

    Each has its own tensors, in order of the frugality, between which `frugal` interpolates.
    """
    further = dict(sorted((float(value), weights) for value, weights in table.items()))
    if not architecture.authority or len(further) < 2 or (min(further), max(further)) != (0.0, 1.0):
        raise ValueError(
            "it has weights of frugalities that are not from 0 to 1, or is no agent for any craft"
        )
    return {
        value: _network(architecture, weights, False).tensors for value, weights in further.items()
    }


def _network(
    architecture: Architecture, weights: Mapping[str, Tensor], has_critic: bool = True
) -> Network:
    """Network of these weights in single precision; a missing critic is zero.

    Raises:
        ValueError: the weights belong to another architecture.
        ConfigError: a weight is not finite, or not in single precision.
    """
    shapes = architecture.shapes() if len(architecture.layers) <= len(weights) else {}
    # A zero critic is one layer on the actor's features, whose size the actor's weights bound.
    needed = {
        name: shape
        for name, shape in shapes.items()
        if has_critic or not name.startswith("value_net.")
    }
    if {name: x.shape for name, x in weights.items()} != needed:
        raise ValueError("its weights are not those of the network that it describes")
    tensors = {
        name: weights[name].float() if name in needed else torch.zeros(shape)
        for name, shape in shapes.items()
    }
    for name, tensor in tensors.items():
        if not tensor.isfinite().all():
            raise ConfigError(
                f"the agent's tensor {name} has numbers that are not finite, so it "
                "cannot be flown: its training diverged, or the file was changed."
            )
    return Network(architecture, tensors)


def _table(architecture: Architecture) -> dict[str, Any]:
    """Table of an architecture, as `_architecture` reads it: a renamed field of either breaks every file."""
    views = architecture.symmetries
    own = {
        field.name: plain(getattr(architecture, field.name))
        for field in fields(Architecture)
        if field.name not in ("layout", "symmetries", "filters")
    }
    tables = (
        None
        if views is None
        else {name: torch.as_tensor(table) for name, table in views._asdict().items()}
    )
    filters = architecture.filters
    return own | {
        "layout": [_described(block) for block in architecture.layout.blocks],
        "symmetries": tables,
        "filters": None if filters is None else plain(filters._asdict()),
    }


def _architecture(table: dict[str, Any]) -> Architecture:
    """Architecture from its table; ValueError, KeyError or TypeError if the table is wrong.

    Entries are taken out of the table. Old files must be read as what they were, or refused.
    """
    # Values of their own kinds; agents of early versions lack some, or have others in their place.
    views = table.pop("symmetries")
    if views is not None:
        views = Symmetries(*(views[name].numpy() for name in Symmetries._fields))
    filters = table.pop("filters", None)  # which agents of before did not have
    bank = None if filters is None else ESTIMATORS["filters"].read(filters)
    if "continuous" in table:  # agents of before had one head for either kind of craft
        table["head"] = "gaussian" if table.pop("continuous") else "on-off"
    if (frame := table.pop("preprocessor", "body")) != "body":
        raise ConfigError(
            f"the agent observes vectors in the {brief(frame)} frame, which this version does not compute: train "
            "it anew."
        )
    # Empty in most files of before.
    if table.pop("units", 0) or table.pop("levers", ()):
        raise ConfigError(
            "the agent has a recurrent memory or the head 'guided', which this version does not have: train it "
            "anew with the memory 'history' and the head 'auto'."
        )
    blocks = Layout(tuple(_block(row) for row in table.pop("layout")))
    architecture = Architecture(
        blocks,
        symmetries=views,
        filters=bank,
        **{name: _value(name, x) for name, x in table.items()},
    )
    _check_names(architecture)
    _check_craft(architecture)
    _check_numbers(architecture)
    return architecture


def _check_names(architecture: Architecture) -> None:
    """Refuse (`ValueError`) parts that this version does not have."""
    choices = {
        "head": (architecture.head, HEADS),
        "activation": (architecture.activation, ACTIVATIONS),
        "backbone": (architecture.backbone, BACKBONES),
    }
    for name, (key, available) in choices.items():
        if key not in available:
            raise ValueError(f"its {name} {brief(key)} is unknown here")


def _check_craft(architecture: Architecture) -> None:
    """Refuse (`ValueError`) tables whose sizes are not those of the thrusters and the observation."""
    bank, views = architecture.filters, architecture.symmetries
    if bank is not None and not bank.fits(architecture.layout.body, architecture.thrusters):
        raise ValueError("its filters are of another spacecraft")
    architecture.kind.check(architecture)
    if views is not None and not _are_views(views, architecture):
        raise ValueError("its symmetries are of another spacecraft")
    if architecture.nominal and len(architecture.nominal) != architecture.privileged:
        raise ValueError("its critic observes quantities of another spacecraft")


def _check_numbers(architecture: Architecture) -> None:
    """Refuse (`ValueError`) numbers that are not finite, in every table of an architecture that has numbers."""
    numbers = {
        "filters": architecture.filters or (),
        "symmetries": architecture.symmetries or (),
        "nominal": architecture.nominal,
        "averages": architecture.averages,
        "zoom": architecture.zoom,
        "tokens": architecture.tokens,
        "authority": architecture.authority,
        "coast": architecture.coast,
        "farthest": (architecture.farthest, architecture.farthest_lost),
        "filling": architecture.filling,
        "frugal": architecture.frugal,
        "reach": architecture.reach,
        "clip": architecture.clip,
    }
    for name, values in numbers.items():
        if not _are_finite(values):
            raise ValueError(f"in its {name} there are numbers that are not finite")


def _value(name: str, value: Any) -> Any:
    """Value of a field of the architecture, converted to its type."""
    if name in _LISTS:
        return tuple(map(_LISTS[name], value))
    return int(value) if name == "thrusters" else type(getattr(Architecture, name))(value)


def _are_views(views: Symmetries, architecture: Architecture) -> bool:
    """Whether the tables of the symmetries have the shapes and indices of this architecture."""
    count = len(views.turn)
    axes = views.turn.shape[-1]
    shapes = views.turn.shape, views.hand.shape, views.place.shape
    starts = views.place.astype(int)
    return (
        shapes == ((count, axes, axes), (count,), (count, architecture.thrusters))
        and axes in (2, 3)
        and count > 0
        and bool(((starts >= 0) & (starts < architecture.thrusters)).all())
    )


def _are_finite(values: Any) -> bool:
    """Whether a number, an array, or nested tuples of them are finite."""
    if isinstance(values, tuple | list):
        return all(map(_are_finite, values))
    return bool(np.isfinite(values).all())


def _described(block: Block) -> list[Any]:
    """JSON of a block of columns: the name of its class, its width, and its choices."""
    choices = [[flag, [_described(choice) for choice in blocks]] for flag, blocks in block.choices]
    return [f"{block.kind.__module__}.{block.kind.__qualname__}", block.width, choices]


def _block(row: list[Any]) -> Block:
    """Block of an observation from its row in an agent's file, as `_described` made it; of a known kind.

    Files name kinds of columns by module and class: one that is moved or renamed needs an entry in
    `_KINDS_OF_FILES`.
    """
    kind, width, choices = row
    module, _, name = kind.rpartition(".")
    if module == "rans.tasks.sight":
        kind = f"{ObservationTerm.__module__}.{_KINDS_OF_FILES.get(name, name)}"
    kinds = {
        f"{subclass.__module__}.{subclass.__qualname__}": subclass
        for subclass in _kinds(ObservationTerm)
    }
    if kind not in kinds:  # nothing is imported by the name in a file
        raise ValueError(f"it observes columns of the unknown kind {kind}")
    return Block(
        kinds[kind],
        int(width),
        tuple((float(flag), tuple(map(_block, blocks))) for flag, blocks in choices),
    )


_KINDS_OF_FILES = {
    "Entry": "ObservationTerm",
    "Spin": "AngularVelocity",
    "Turn": "RelativeRotation",
    "OwnAttitude": "OwnRotation",
    "Drawn": "TaskDependent",
    "Knob": "TradeOff",
}
"""Names of observation terms in files of weights, where they are not those of the classes."""


def _kinds(base: type[ObservationTerm]) -> Iterator[type[ObservationTerm]]:
    yield base
    for subclass in base.__subclasses__():
        yield from _kinds(subclass)
