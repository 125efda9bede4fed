"""What peers' trainers run with, where they cannot import ours."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

from rans.fast.learn.recipes import preset
from validation.peers import runner


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_they_are_our_presets(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(runner.__file__).parent))
    theirs = importlib.import_module("ppo_settings").SETTINGS[device]
    ours = preset("go-to-pose", 2, device)
    assert {name: getattr(ours, name) for name in theirs._fields} == theirs._asdict()
    assert len(set(ours.layers)) == 1  # RLtools' layers are all as wide
