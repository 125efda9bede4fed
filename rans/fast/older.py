"""Agents of older versions, which kept all but their weights in pickles: read without unpickling any.

Arrays come through torch's reader of weights only, numbers from the JSON beside the pickles, and what else a
network is follows from the spacecraft and the task that it is for.
"""

from __future__ import annotations

import io
import json
import math
import re
import zipfile
from dataclasses import asdict
from typing import Any

from torch import Tensor

from rans.fast.archives import content
from rans.fast.learn.architecture import EXTRACTOR, Architecture, paper_layout
from rans.fast.learn.config import PPOSettings
from rans.fast.pickled import load_tensors
from rans.fast.privileged import relative
from rans.fast.symmetry import symmetries
from rans.model.body import Body
from rans.model.spacecraft import Spacecraft
from rans.structure import structure
from rans.tasks.base import Task
from rans.tasks.derived import example, layout

_SETTINGS = "rans_settings"
_OTHER_PARTS = ("pi_features_extractor.", "vf_features_extractor.")
"""Names under which SB3 lists the same weights again."""


def is_ours(archive: zipfile.ZipFile) -> bool:
    """Whether the policy that SB3 saved has a network of ours; an error where there is none."""
    made = _data(archive).get("policy_kwargs", {})
    extractor = str(made.get("features_extractor_class"))
    return extractor == "<class 'rans.fast.policy.NormalisedMlp'>" and not made.get("net_arch")


def weights(archive: zipfile.ZipFile) -> dict[str, Tensor]:
    """Weights and statistics by their names."""
    table = arrays(archive, "policy.pth")
    return {name: x for name, x in table.items() if not name.startswith(_OTHER_PARTS)}


def arrays(archive: zipfile.ZipFile, name: str) -> dict[str, Any]:
    """What torch saved under this name, if it is arrays and numbers only."""
    return load_tensors(io.BytesIO(content(archive, name)), f"{archive.filename}/{name}")


def steps(archive: zipfile.ZipFile) -> int:
    """Environment steps learned from."""
    return int(_data(archive).get("num_timesteps", 0))


def settings(archive: zipfile.ZipFile) -> dict[str, Any]:
    """Those of the training, as far as the file tells them without a pickle."""
    data = _data(archive)
    return known(
        {name: value for name, value in data.items() if not isinstance(value, dict)}
        | data.get(_SETTINGS, {})
    )


def known(table: dict[str, Any]) -> dict[str, Any]:
    """The entries that `PPOSettings` has, in their types and ranges; others are as by default."""
    own = {name: value for name, value in table.items() if name in PPOSettings.__dataclass_fields__}
    if isinstance(steady := own.get("filtered_steady"), float):  # once one for all filters
        own["filtered_steady"] = [steady] * len(own["filters"]) if steady else []
    return asdict(structure(own, PPOSettings, "settings"))


def architecture(archive: zipfile.ZipFile, craft: Spacecraft, task: Task) -> Architecture:
    """The network's, if it is for this spacecraft and this task."""
    data = _data(archive)
    tensors = weights(archive)
    said = _arguments(archive)
    width = int(data["observation_space"]["_shape"][0])
    continuous = "log_std" in tensors
    seen = layout(task, craft.dimension) if "'layout'" in said else paper_layout(width)
    rows = len(tensors["action_net.bias"])
    privileged = int(_number(said, "privileged"))
    nominal = tuple(relative(Body.of(craft), craft)) if "'nominal': (" in said else ()
    return Architecture(
        layout=seen,
        thrusters=rows if continuous else rows // 2,
        layers=_layers(tensors),
        activation=_word(said, "activation"),
        zoom=_number(said, "zoom"),
        symmetries=symmetries(craft) if "'symmetries': Symmetries(" in said else None,
        bf16="'bf16': True" in said,
        continuous=continuous,
        history=int(_number(said, "history")),
        units=int(_number(said, "units")),
        privileged=privileged,
        nominal=nominal if privileged else (),
        bounds=example(task, craft.dimension).bounds(),
    )


def _layers(tensors: dict[str, Tensor]) -> tuple[int, ...]:
    trunk = f"{EXTRACTOR}trunk."
    return tuple(
        len(x) for name, x in tensors.items() if name.startswith(trunk) and name.endswith(".bias")
    )


def _data(archive: zipfile.ZipFile) -> dict[str, Any]:
    table = json.loads(content(archive, "data"))
    if not isinstance(table, dict):
        raise ValueError("it holds no agent")
    return table


def _arguments(archive: zipfile.ZipFile) -> str:
    """The network's settings as Python prints them, which SB3 writes beside what it pickles."""
    return str(_data(archive)["policy_kwargs"].get("features_extractor_kwargs", {}))


def _word(said: str, name: str) -> str:
    found = re.search(rf"'{name}': '(\w+)'", said)
    return found[1] if found else str(getattr(Architecture, name))


def _number(said: str, name: str) -> float:
    found = re.search(rf"'{name}': ([\d.e+-]+)", said)
    value = float(found[1]) if found else float(getattr(Architecture, name))
    if not math.isfinite(value):
        raise ValueError(f"{name} must be finite, got {value}")
    return value
