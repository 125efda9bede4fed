"""Rows of metrics where other people keep theirs."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from rans.errors import ConfigError
from rans.fast.learn.loggers import LoggerName, loggers, require_loggers
from tests.support.training import CONFIG

ROWS: list[dict[str, Any]] = [
    {"steps": steps, "success": 0.5, "steps_per_s": 1e4, "return/position": 7.0}
    for steps in (100, 200)
]


def test_hyper_parameters_stand_in_tensorboards_table(tmp_path: Path) -> None:
    (one,) = loggers(["hparams", "hparams"], CONFIG, tmp_path)
    for row in ROWS:
        one.write(row)
    one.close()
    (file,) = (tmp_path / "tensorboard").iterdir()
    for told in (b"_hparams_", b"ppo.gamma", b"settings.thrust_weight", b"evaluation/success"):
        assert told in file.read_bytes()


@pytest.mark.parametrize("name", ["wandb", "mlflow"])
def test_libraries_are_told_config_and_rows(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Through the calls that their documents name; neither is installed with RANS."""
    told: list[Any] = []

    def call(what: str) -> Any:
        return lambda *given, **named: told.append((what, given, named)) or library

    library = SimpleNamespace(
        **{
            what: call(what)
            for what in (
                "init",
                "log",
                "finish",
                "set_experiment",
                "start_run",
                "log_params",
                "log_metrics",
                "end_run",
            )
        }
    )
    monkeypatch.setitem(sys.modules, name, cast("Any", library))
    (one,) = loggers([cast("LoggerName", name)], CONFIG, tmp_path / "mine")
    for row in ROWS:
        one.write(row)
    one.close()
    written = [
        (given[0], named["step"]) for what, given, named in told if what in ("log", "log_metrics")
    ]
    assert written == [(row, row["steps"]) for row in ROWS]
    config = next(
        given[0] if given else named["config"]
        for what, given, named in told
        if what in ("init", "log_params")
    )
    assert config["ppo.gamma"] == CONFIG.ppo.gamma
    assert told[-1][0] in ("finish", "end_run")


def test_a_service_that_refuses_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "wandb", cast("Any", SimpleNamespace(init=lambda **_: 1 / 0)))
    with pytest.raises(ConfigError, match="--log wandb cannot start: division by zero"):
        loggers(["wandb"], CONFIG, tmp_path)


@pytest.mark.parametrize("name", ["wandb", "mlflow"])
def test_what_is_not_installed_is_told(name: str) -> None:
    if importlib.util.find_spec(name) is not None:
        pytest.skip("it is installed")
    said = f"--log {name} needs the package {name} .No module .* pip install {name}"
    with pytest.raises(ConfigError, match=said):
        require_loggers([cast("LoggerName", name)])
