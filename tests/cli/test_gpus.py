"""``--gpus``: who may have it, what it starts, and one training by two processes on the CPU."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch

from rans.cli import main
from rans.fast.learn.run_folder import RunFolder

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _two_gpus(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    monkeypatch.delenv("WORLD_SIZE", raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")  # which a launch sets if nobody has


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("list --gpus all", "rans list does not divide its work among GPUs"),
        ("train go-to-pose --gpus some", "--gpus must be all, or a number of GPUs; got 'some'."),
        ("train go-to-pose --gpus 0", "--gpus must be all, or a number of GPUs; got '0'."),
        ("train go-to-pose --gpus 3", "--gpus must be at most the 2 GPUs here, got 3."),
        ("train go-to-pose --gpus", "nothing follows it."),
    ],
)
def test_a_wrong_option_is_one_sentence_before_any_process_starts(
    line: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line.split()) == 2
    assert sentence in capsys.readouterr().err


def test_all_of_no_gpu_and_processes_of_torchrun_are_sentences(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
    assert main(["train", "go-to-pose", "--gpus", "all"]) == 2
    assert "there is none here" in capsys.readouterr().err
    monkeypatch.setenv("WORLD_SIZE", "2")
    assert main(["train", "go-to-pose", "--gpus", "2"]) == 2
    assert "run the command without torchrun" in capsys.readouterr().err


@pytest.mark.parametrize(("text", "count"), [("all", "2"), ("1", "1")])
def test_torchrun_gets_the_command_without_the_option(
    text: str, count: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Options such as --log and --run, beginnings of torchrun's own, stay the command's."""
    started: list[Any] = []
    monkeypatch.setattr("torch.distributed.run.run", started.append)
    own = ["train", "go-to-pose", "--log", "wandb", "--output", "x"]
    assert main([*own[:2], f"--gpus={text}", *own[2:]]) == 0
    (options,) = started
    assert (options.standalone, options.module, options.nproc_per_node) == (True, True, count)
    assert (options.training_script, options.training_script_args) == ("rans", own)


@pytest.mark.parametrize("failing", [True, False])
def test_an_interrupt_is_printed_only_where_no_process_failed(
    failing: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Torchrun ends the others of a process that failed, and they may come first. Only the first writes."""

    def processes(_: object) -> None:
        monkeypatch.setattr("rans.cli._run", interrupt)
        monkeypatch.setattr("rans.cli.has_written", lambda: os.environ["RANK"] == "0")
        for rank in ("0", "1"):
            monkeypatch.setenv("RANK", rank)
            assert main(["list"]) == 130
        if failing:
            monkeypatch.undo()
            monkeypatch.setenv("RANK", "1")
            assert main(["list", "nothing"]) == 2

    def interrupt(_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr("torch.distributed.run.run", processes)
    main(["train", "go-to-pose", "--gpus", "2"])
    error = capsys.readouterr().err
    assert ("'nothing'" in error) is failing
    assert error.count("interrupted") == (0 if failing else 1)
    assert ("what was written is kept" in error) is not failing


@pytest.mark.slow
def test_two_processes_train_on_the_cpu(tmp_path: Path) -> None:
    """As one process does, by which the sum of their steps is counted; a refusal has the code of one process."""
    command = [sys.executable, "-m", "rans", "train", "go-to-pose", "--gpus", "2"]
    settings = "ppo.n_envs=64 ppo.n_steps=4 ppo.batch_size=128 device=cpu total_timesteps=512"
    for setting in settings.split():
        command += ["--set", setting]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [*command, "--output", "run"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "2 processes use the CPU" in done.stdout
    assert RunFolder(tmp_path / "run").load_checkpoint("cpu")["steps"] == 512


@pytest.mark.slow
def test_a_wrong_setting_is_one_sentence_of_all_processes(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rans", "train", "go-to-pose", "--gpus", "2", "--set", "nonsense=1"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT), "CUDA_VISIBLE_DEVICES": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.count("nonsense") == 1
    assert "interrupted" not in done.stderr
