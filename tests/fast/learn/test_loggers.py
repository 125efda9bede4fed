"""Rows of metrics where other people keep theirs."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from rans.errors import ConfigError
from rans.fast.learn.loggers import loggers, require_loggers
from tests.support.training import CONFIG


def test_wandb_gets_config_and_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Through the calls that its documents name; it is not installed with RANS."""
    told: list[Any] = []

    def call(what: str) -> Any:
        return lambda *given, **named: told.append((what, given, named)) or library

    library = SimpleNamespace(**{what: call(what) for what in ("init", "log", "finish")})
    monkeypatch.setitem(sys.modules, "wandb", cast("Any", library))
    (one,) = loggers(["wandb", "wandb"], CONFIG, tmp_path / "mine")
    one.write(row := {"steps": 100, "success": 0.5})
    one.close()
    assert told[0][2]["config"]["ppo.gamma"] == CONFIG.ppo.gamma
    assert told[1:] == [("log", (row,), {"step": 100}), ("finish", (), {})]


def test_a_service_that_refuses_or_is_missing_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if importlib.util.find_spec("wandb") is None:
        with pytest.raises(ConfigError, match="--log wandb needs the package wandb"):
            require_loggers(["wandb"])

    def refuses(**_: Any) -> None:
        raise ValueError("no key")

    monkeypatch.setitem(sys.modules, "wandb", cast("Any", SimpleNamespace(init=refuses)))
    with pytest.raises(ConfigError, match="--log wandb cannot start: no key"):
        loggers(["wandb"], CONFIG, tmp_path)
