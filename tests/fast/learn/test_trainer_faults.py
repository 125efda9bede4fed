"""What goes wrong in a training is one sentence, and what was written before survives."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rans.errors import ConfigError, NonFiniteState
from rans.fast.agent_files.tensors import pack_tensors, unpack_tensors
from rans.fast.stepping.compiled import ArrayStep
from rans.files import LOCK
from rans.tasks import GoToPose
from tests.support.training import after, ignore, resumed, tiny_trainer


@pytest.mark.filterwarnings(
    "ignore:this engine steps slower"
)  # for a reward that no program is made of
@pytest.mark.parametrize("what", ["weight", "state", "reward"])
def test_nan_stops_it(tmp_path: Path, what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    trainer = tiny_trainer(tmp_path / "run")
    trainer.train(ignore, after(2))
    before = trainer.run.checkpoint_file.read_bytes()
    if what == "weight":
        with torch.no_grad():
            trainer.learner.network.tensors["value_net.weight"][0, 0] = float("nan")
    elif what == "state":
        trainer.engine.state.p.x[3] = float("nan")
    else:
        trainer.engine._step = ArrayStep()  # with the reward that follows
        monkeypatch.setattr(
            GoToPose, "reward", lambda *_: {"position": np.full(16, np.nan, np.float32)}
        )
    sentence = r"not finite after 384 steps .* State and weights are in .*nonfinite\.safetensors"
    with pytest.raises(NonFiniteState, match=sentence):
        trainer.train(ignore)
    dump = unpack_tensors((tmp_path / "run" / "nonfinite.safetensors").read_bytes(), "dump")
    assert dump["steps"] == 384
    assert trainer.run.checkpoint_file.read_bytes() == before


@pytest.mark.parametrize(
    "failing", ["checkpoint.safetensors", "agent.safetensors", "metrics.jsonl"]
)
def test_a_full_disk(tmp_path: Path, failing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One sentence, and what was written before is still there to continue from."""
    trainer = tiny_trainer(tmp_path / "run")
    trainer.train(ignore, after(2))
    before = {file.name: file.read_bytes() for file in tmp_path.joinpath("run").glob("*.*")}
    real_replace = os.replace
    real_open = os.open

    def replace_(source: Any, target: Any) -> None:
        if Path(target).name == failing:
            raise OSError(28, "No space left on device")
        real_replace(source, target)

    def open_(path: Any, flags: int, *rest: Any, **named: Any) -> int:
        if Path(path).name == failing and flags & os.O_APPEND:
            raise OSError(28, "No space left on device")
        return real_open(path, flags, *rest, **named)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", replace_)
        patch.setattr(os, "open", open_)
        with pytest.raises(ConfigError, match=rf"cannot write .*{failing}: .*No space left"):
            trainer.train(ignore)
    assert tmp_path.joinpath("run", failing).read_bytes() == before[failing]
    hidden = [file.name for file in tmp_path.joinpath("run").glob(".*")]
    assert hidden == [LOCK], "no half-written file is left over"
    again = resumed(tmp_path / "run")
    again.train(ignore)
    assert again.steps == 2048


def test_a_checkpoint_of_another_config(tmp_path: Path) -> None:
    tiny_trainer(tmp_path / "run").train(ignore, after(1))
    table = json.loads((tmp_path / "run" / "config.json").read_text())
    for key, value, message in (
        ("layers", [8, 8], r"its network is another one \(layers \(16, 16\)"),
        ("n_envs", 32, "saved state is not one of 32"),
        ("symmetric", False, "its network is another one .*symmetric True"),
    ):
        changed = table | {"ppo": table["ppo"] | {key: value}}
        (tmp_path / "run" / "config.json").write_text(json.dumps(changed))
        with pytest.raises(ConfigError, match=message) as caught:
            resumed(tmp_path / "run")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("damaged", [b"", b"rubbish", b"half", b"other"])
def test_a_damaged_checkpoint(tmp_path: Path, damaged: bytes) -> None:
    trainer = tiny_trainer(tmp_path / "run")
    trainer.train(ignore, after(1))
    file = trainer.run.checkpoint_file
    content = file.read_bytes()
    file.write_bytes({b"half": content[: len(content) // 2]}.get(damaged, damaged))
    if damaged == b"other":
        file.write_bytes(pack_tensors([1, 2, 3]))
    with pytest.raises(
        ConfigError, match=r"checkpoint\.safetensors (is damaged|does not fit)"
    ) as caught:
        resumed(tmp_path / "run")
    assert "\n" not in str(caught.value)
