"""One list of questions to every reader of files: a planted file for each, whole, that means something else.

Damage is tested elsewhere (`tests/test_damaged_files.py`). Here a file is what its format allows, and the question
is whether what it says is read, or refused: a new reader without answers fails the first test.
"""

from __future__ import annotations

import ast
import hashlib
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rans_missions.ccsds import read_opm

from rans import GoToPose
from rans.base.files import write_json
from rans.base.pretrained import pretrained_folder
from rans.evaluation.fly.exported import read_contract
from rans.evaluation.fly.tuned import Tuned
from rans.evaluation.fly.user_policy import user_policy
from rans.fast.agent_files.agent import read_policy
from rans.fast.agent_files.tensors import pack_tensors, unpack_tensors
from rans.fast.learn.run_folder import read_config
from rans.model.spacecraft_file import load_spacecraft, read_spacecraft
from rans.randomization.conditions_file import load_conditions
from tests.support.graphs import model_of, step
from tests.support.processes import ROOT
from tests.support.reader_questions import (
    QUESTIONS,
    Answer,
    Answers,
    check_said,
    planted,
    written,
)
from tests.support.sources import sources
from tests.support.written_files import TUNED

# planted files

OPM = """CCSDS_OPM_VERS = 3.0
OBJECT_NAME = A
CENTER_NAME = EARTH
REF_FRAME = EME2000
TIME_SYSTEM = UTC
EPOCH = 2026-01-01T00:00:00
X = 7000.0 [km]
Y = 0 [km]
Z = 0 [km]
X_DOT = 0 [km/s]
Y_DOT = 7.5 [km/s]
Z_DOT = 0 [km/s]
"""


def opm(old: str, new: str) -> Any:
    assert old in OPM
    return written("a.opm", OPM.replace(old, new), read_opm)


PLATFORM = (ROOT / "rans/data/spacecraft/floating-platform.toml").read_text()
CRAFT = load_spacecraft("floating-platform")


def toml(old: str, new: str) -> Any:
    text = re.sub(old, new, PLATFORM, count=1, flags=re.MULTILINE)
    assert text != PLATFORM
    return written("craft.toml", text, read_spacecraft)


def table(name: str, read: Callable[[Path], object], change: Callable[[Any], object]) -> Any:
    """A JSON file of a shipped agent's run folder with a change."""

    def plant(folder: Path) -> Callable[[], object]:
        shutil.copytree(pretrained_folder("go-to-pose-2d"), folder, dirs_exist_ok=True)
        content = json.loads((folder / name).read_text())
        change(content)
        write_json(folder / name, content)
        return lambda: read(folder / name)

    return plant


def policy(change: Callable[[dict[str, Any]], object]) -> Any:
    def plant(folder: Path) -> Callable[[], object]:
        source = pretrained_folder("go-to-pose-2d") / "agent.safetensors"
        tree = unpack_tensors(source.read_bytes(), source)
        change(tree)
        (folder / "agent.safetensors").write_bytes(pack_tensors(tree))
        return lambda: read_policy(folder / "agent.safetensors")

    return plant


def contract(**changed: object) -> Any:
    hashed = hashlib.sha256(PLATFORM.encode()).hexdigest()
    about = {
        "format": 3,
        "task": "go-to-pose",
        "agent": "mine",
        "settings": {},
        "control_period": 0.2,
        "readings": {"oldest": 0.02},
        "observation": [{"column": 0, "unit": "m", "refused": [-1.0, 1.0]}],
        "spacecraft": {"file": "spacecraft.toml", "sha256": hashed},
    }

    def plant(folder: Path) -> Callable[[], object]:
        (folder / "spacecraft.toml").write_text(PLATFORM)
        read_contract(written("contract.json", json.dumps(about), Path)(folder)().parent)
        return written(
            "contract.json", json.dumps(about | changed), lambda file: read_contract(file.parent)
        )(folder)

    return plant


def network(width: int = 10, memory: bool = False) -> Any:
    """An ONNX network that observes so many numbers, with an LSTM that hides its state or without."""

    def plant(folder: Path) -> Callable[[], object]:

        random = np.random.default_rng(0)

        nodes = [step("MatMul", "o w", "c")]
        shapes: dict[str, tuple[int, ...]] = {"w": (width, 8)}
        if memory:
            nodes = [
                step("Unsqueeze", "o axes", "s"),
                step("LSTM", "s w r", "- h", hidden_size=8),
                step("Squeeze", "h axes", "c"),
            ]
            shapes = {"w": (1, 32, width), "r": (1, 32, 8)}
        tables: Any = {name: random.normal(size=shape) for name, shape in shapes.items()}
        ends = {"o": ("N", width)}, {"c": ("N", 8)}
        content = model_of(nodes, *ends, axes=np.array([0]), **tables)
        (folder / "net.onnx").write_bytes(content)
        flown = GoToPose()
        seen = np.ones((2, 10), np.float32)
        return lambda: user_policy(f"onnx:{folder / 'net.onnx'}", CRAFT, flown).act(0, 0, seen)

    return plant


def pickled(folder: Path) -> Callable[[], object]:
    """A policy of Stable-Baselines3, flown without trust."""
    (folder / "policy.zip").write_bytes(b"of another library")
    return lambda: user_policy(f"sb3:{folder / 'policy.zip'}", CRAFT, GoToPose())


def tuned(**changed: object) -> Any:
    def plant(folder: Path) -> Callable[[], object]:
        write_json(folder / "lqr.json", json.loads(TUNED.read_text()) | changed)
        return lambda: Tuned.read(folder / "lqr.json")

    return plant


ANSWERS: Answers = {
    "read_opm": {
        "units": Answer(opm("7000.0 [km]", "23e6 [ft]"), r"X of .* is in '\[ft\]'"),
        "frames": Answer(opm("EME2000", "ITRF2000"), "turns with the Earth"),
        "times": Answer(opm("2026-01-01T", "2026-366T"), "must be an instant"),
        "order": Answer(opm("Z_DOT = 0", "X = 6900"), "X stands twice"),
        "dropped": Answer(
            opm("OBJECT_NAME", "MAN_EPOCH_IGNITION = 2026-01-02T00:00:00\nOBJECT_NAME"),
            "has 1 manoeuvre, which RANS does not read",
            is_warning=True,
        ),
        "sizes": Answer(
            opm("OBJECT_NAME", "COMMENT x\n" * 200_000 + "OBJECT_NAME"), "are read; it is probably"
        ),
        "evidence": Answer(opm("7000.0 [km]", "7000000.0"), "usual cause are other units"),
    },
    "read_spacecraft": {
        "units": Answer(toml(r"^radius = .*", "radius = 310.0"), "in mm or cm", is_warning=True),
        "frames": "there is one frame G, which each file chooses",
        "times": "a body has none",
        "order": Answer(toml(r"^dimension = 2", "dimension = 4"), "dimension"),
        "dropped": Answer(toml(r"^radius = ", "drag = 2.2\nradius = "), "drag"),
        "sizes": Answer(
            toml(r"^radius = ", "#" + "x" * 2**24 + "\nradius = "), "are read; it is probably"
        ),
        "evidence": Answer(toml(r"^mass = .*", "mass = -5.0"), "mass"),
    },
    "load_conditions": {
        "units": "each key has its unit, and none is written in the file",
        "frames": "each key has its frame, and none is written in the file",
        "times": Answer(
            written("w.toml", "[thrusters]\nlatency = [0.2, 0.1]\n", load_conditions), "latency"
        ),
        "order": Answer(written("w.toml", "[body]\nmass = [1.2, 0.8]\n", load_conditions), "mass"),
        "dropped": Answer(
            written("w.toml", "[thrusters]\nlag = 0.1\n", load_conditions), "unknown key .lag."
        ),
        "sizes": Answer(
            written("w.toml", "#" + "x" * 2**24, load_conditions), "are read; it is probably"
        ),
        "evidence": Answer(
            written("w.toml", "[body]\nmass = [-1.0, 1.0]\n", load_conditions), "mass"
        ),
    },
    "read_config": {
        "units": "each key has its unit, and none is written in the file",
        "frames": "a training has none",
        "times": Answer(
            table("config.json", read_config, lambda x: x["timing"].update(control_period=-0.2)),
            "control_period",
        ),
        "order": "each key has one meaning",
        "dropped": Answer(
            table("config.json", read_config, lambda x: x.update(wings=2)), "unknown key .wings."
        ),
        "sizes": Answer(
            table("config.json", read_config, lambda x: x["ppo"].update(n_envs=2**40)), "n_envs"
        ),
        "evidence": Answer(
            table("config.json", read_config, lambda x: x.update(task="go-to-mars")), "go-to-mars"
        ),
    },
    "read_policy": {
        "units": "columns of observations have those of their tasks",
        "frames": Answer(policy(lambda x: x["architecture"].update(layout={})), "damaged"),
        "times": "a network has none",
        "order": "columns are named by the layout, which is compared with the task's",
        "dropped": Answer(policy(lambda x: x["architecture"].update(wings=2)), "damaged.*wings"),
        "sizes": Answer(
            policy(lambda x: x["architecture"].update(layers=[2**40, 2**40])), "damaged"
        ),
        "evidence": Answer(policy(lambda x: x["weights"].popitem()), "damaged"),
    },
    "read_contract": {
        "units": "each key has its unit, and none is written in the file",
        "frames": Answer(contract(task=3), "task must be a text"),
        "times": Answer(contract(control_period=0.0), "control_period"),
        "order": "columns are named, and the agent reads them in their order",
        "dropped": "a contract is for people and machines; what flights need is read",
        "sizes": "it is a table of texts, bounded as all JSON files are",
        "evidence": Answer(contract(settings=[1]), "settings must be a table"),
    },
    "onnx": {
        "units": "a network's numbers have none",
        "frames": "a network names none; docs/comparison.md says what it must observe",
        "times": "a network has none",
        "order": Answer(network(), "does not take"),
        "dropped": Answer(network(memory=True), r"has a memory \(LSTM\)"),
        "sizes": Answer(network(width=22), "observes 22 numbers"),
        "evidence": "of the first batch it is asked twice and alone (tests/evaluation/fly)",
    },
    "sb3": {
        "units": "a network's numbers have none",
        "frames": "a network names none; docs/comparison.md says what it must observe",
        "times": "a network has none",
        "order": "spaces are compared (tests/evaluation/fly/test_controllers.py)",
        "dropped": "statistics beside it are applied (tests/evaluation/fly/test_normalized_policies.py)",
        "sizes": "what is trusted has no bound",
        "evidence": Answer(pickled, "is a pickle"),
    },
    "Tuned.read": {
        "units": "settings of a controller have those of its fields",
        "frames": "settings have none",
        "times": "`Tuned.fits` compares the timing",
        "order": "each key has one meaning",
        "dropped": Answer(tuned(wings=2), r"lqr\.json"),
        "sizes": "it is a table of numbers, bounded as all JSON files are",
        "evidence": Answer(tuned(settings=[1]), r"lqr\.json"),
    },
}

PACKAGES = {
    file.parent.parent.name: file
    for file in sorted(ROOT.glob("packages/*/tests/test_reader_answers.py"))
}
"""Answers of the readers that a package has, beside their tests."""


def answered(file: Path) -> set[str]:
    """Readers in the table `ANSWERS` of a file, each with all questions."""
    [table] = [
        node.value
        for node in ast.parse(file.read_text("utf-8")).body
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "ANSWERS"
    ]
    assert isinstance(table, ast.Dict)
    found = set()
    for key, value in zip(table.keys, table.values, strict=True):
        assert isinstance(key, ast.Constant)
        assert isinstance(value, ast.Dict)
        assert [ast.literal_eval(one) for one in value.keys if one] == [*QUESTIONS], key.value
        found.add(str(key.value))
    return found


PARTS = {
    "read_bytes": "bytes, bounded; others give them a meaning",
    "read_text": "the same",
    "read_json": "the same",
    "read_json_lines": "the same",
    "load_spacecraft": "read_spacecraft reads the file",
    "load_exported": "read_contract, read_spacecraft and the network",
    "load_policy": "read_policy",
    "load_agent": "all of these by their names",
    "load_task": "a name in the registry",
    "load_from_zip_file": "of another library",
}
"""Functions that read files by others of the list, or without a meaning of their own."""


def readers() -> set[str]:
    """Functions of the package that are called read or load, and take a path or a file's content."""
    found = set()
    for _, file in sources():
        text = file.read_text("utf-8")
        if "def read_" not in text and "def load_" not in text:
            continue
        for node in ast.parse(text).body:
            if not isinstance(node, ast.FunctionDef) or not re.match("(read|load)_", node.name):
                continue
            kinds = [ast.unparse(one.annotation) for one in node.args.args if one.annotation]
            if any("Path" in kind for kind in kinds):
                found.add(node.name)
    return found


def test_every_reader_answers():
    found = readers()
    assert {"read_opm", "read_foreign", "read_policy", "read_config"} <= found  # the scan works
    elsewhere = {reader for file in PACKAGES.values() for reader in answered(file)}
    silent = sorted(found - ANSWERS.keys() - elsewhere - PARTS.keys())
    assert not silent, f"answer the questions for {silent}"


def test_every_package_with_readers_has_answers():
    assert PACKAGES.keys() == {"any_craft", "proof", "robot"}


@planted(ANSWERS)
def test_a_file_that_means_something_else(answer, tmp_path):
    check_said(answer, tmp_path)
