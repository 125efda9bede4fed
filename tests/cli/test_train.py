from __future__ import annotations

import json
import re
import shlex
import signal
import time
import warnings
from pathlib import Path

import pytest
import torch
from rans_any_craft import imitation
from torch import Tensor

import rans
from rans.base.errors import RansWarning
from rans.cli import main, train
from rans.cli.train import StopGently, Train
from rans.fast.agent_files.agent import read_policy
from rans.fast.learn.config import to_table
from rans.fast.learn.run_folder import RunFolder, read_config
from rans.model.spacecraft_file import spacecraft_text
from tests.support.command_runs import tiny
from tests.support.processes import PATIENCE, command
from tests.support.training import weights


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch) -> None:
    """Runs go to a folder of the test's own."""
    monkeypatch.chdir(tmp_path)


def trained(run: str) -> Tensor:
    return weights(read_policy(RunFolder(Path(run)).agent_file).network)


def test_a_run_folder_is_left(capsys):
    assert main([*tiny(), "--set", "total_timesteps=1000"]) == 0
    captured = capsys.readouterr()
    run = Path("runs/go-to-pose-floating-platform-seed0")
    assert captured.out.startswith("Done after 1,024 steps: ")
    assert f"The agent is {run}." in captured.out
    for part in ("training: ", "solved ", "return ", "/s, ", "0:00:00 left"):
        assert part in captured.err
    assert {file.name for file in run.iterdir()} == {
        "config.json",
        "spacecraft.toml",
        "metrics.jsonl",
        "checkpoint.safetensors",
        "agent.safetensors",
        "tensorboard",
        "fly.html",
        ".lock",
    }
    assert main([*tiny(), "--set", "total_timesteps=1000"]) == 0
    assert Path("runs/go-to-pose-floating-platform-seed0-2").is_dir()


@pytest.mark.usefixtures("undrawn")
def test_the_config_gives_the_same_agent():
    """Also where training ends by itself, whenever its reports were made."""
    easy = tiny(
        solved_share=0.01,
        settings__evaluation_distance=[0.1, 0.2],
        settings__position_tolerance=7.9,
        settings__attitude_tolerance=4.0,
        report_interval=3,
        total_timesteps=10**9,
    )
    assert main([*easy, "--seed", "3", "--output", "first"]) == 0
    assert main(["train", "first/config.json", "--output", "again"]) == 0
    assert read_config(Path("again/config.json")) == read_config(Path("first/config.json"))
    assert torch.equal(trained("first"), trained("again"))
    rows = [[row["steps"] for row in RunFolder(Path(run)).metrics()] for run in ("first", "again")]
    assert rows == [[384, 768]] * 2


@pytest.mark.usefixtures("undrawn")
def test_options_change_a_config():
    """Options beat the file, and --set beats options."""
    assert main([*tiny(total_timesteps=100), "--output", "first"]) == 0
    options = "--seed 4 --set total_timesteps=200 --spacecraft floating-platform-air-tank"
    command = f"train first/config.json {options} --set ppo.gamma=0.9 --output second"
    assert main([*command.split()]) == 0
    config = read_config(Path("second/config.json"))
    assert (config.seed, config.total_timesteps, config.ppo.gamma) == (4, 200, 0.9)
    assert config.spacecraft == "floating-platform-air-tank"
    assert config.ppo.layers == (16, 16)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_config_trains_the_spacecraft_that_it_was_used_with(refused):
    """One whose file was changed since, or moved away, is not taken or missed silently."""
    craft = Path("my craft.toml")
    then = "first/spacecraft.toml"
    craft.write_text(spacecraft_text("floating-platform"))
    first = tiny(total_timesteps=100)
    assert main([*first, "--spacecraft", str(craft), "--output", "first"]) == 0
    assert main(["train", "first/config.json", "--output", "same"]) == 0
    craft.write_text(craft.read_text().replace("mass = 5.32", "mass = 9.0"))
    said = refused("train first/config.json --output other")
    assert "my craft.toml has changed since" in said
    assert f"--spacecraft {then} uses that of the run" in said
    assert "--spacecraft 'my craft.toml' the present one" in said
    for given, mass in ((then, 5.32), (str(craft), 9.0)):
        run = f"of-{mass}"
        assert main(["train", "first/config.json", "--spacecraft", given, "--output", run]) == 0
        assert RunFolder(Path(run)).spacecraft().mass == mass
    craft.unlink()
    said = refused("train first/config.json --output other")
    assert "there is no spacecraft file my craft.toml" in said
    assert f"--spacecraft {then} uses that of the run" in said


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_resume_goes_on(ran, refused):
    assert main([*tiny(), "--set", "total_timesteps=512", "--output", "run"]) == 0
    assert "Done after 1,024 steps" in ran("train --resume run --total-timesteps 1.024e3")
    assert "Nothing was left to train: run has 1,024 steps" in ran("train --resume run")
    assert main([*tiny(), "--set", "total_timesteps=1024", "--output", "whole"]) == 0
    assert torch.equal(trained("run"), trained("whole"))
    config = json.loads(Path("run/config.json").read_text())
    assert config["total_timesteps"] == 1024
    assert len(config["about"]["continued"]) == 1
    said = refused("train --resume run --total-timesteps 1k")
    assert "run has 1,024 steps already" in said


def test_wrong_options(refused):
    Path("file").write_text("")
    Path("there").mkdir()
    for typed, said in (
        ("--seed 0 --resume there", "give no other options"),
        ("--device cpu --resume there", "give no other options"),
        ("--output x --resume there", "give no other options"),
        ("--spacecraft floating-platform --resume there", "give no other options"),
        ("--set seed=1 --resume there", "give no other options"),
        ("go-to-pose --resume there", "give no other options"),
        ("go-to-pose --device cpu --output file/run", "cannot write into file/run: file is a file"),
    ):
        assert said in refused(f"train {typed}"), typed


def test_nan_is_said_in_a_sentence(refused):
    text = refused(*tiny(ppo__reward_scale=1e38), "--output", "run")
    assert "not finite after 128 steps" in text
    assert "State and weights are in run/nonfinite.safetensors." in text
    assert Path("run/nonfinite.safetensors").exists()


@pytest.mark.slow
def test_a_signal_stops_it_gently():
    """Nothing is lost, and the command it prints goes on from there; no compiler and no git are needed.

    SIGHUP, of a session that closes; `tests.cli.test_view` sends SIGINT.
    """
    arguments = [*tiny(total_timesteps=10**9), "--output", "run with space"]
    with command(*arguments, PATH="/nowhere", CXX="nothing") as process:
        assert process.stderr is not None
        first = process.stderr.readline()
        assert first.startswith("training: "), first + process.stderr.read()
        process.send_signal(signal.SIGHUP)
        out, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 128 + signal.SIGHUP
    assert "Traceback" not in errors
    assert out.startswith("Stopped after ")
    run = Path("run with space")
    left = {file.name for file in run.iterdir()}
    assert {"agent.safetensors", "checkpoint.safetensors"} <= left
    match = re.search(r"Continue with: rans (.*)\n", out)
    assert match is not None
    assert shlex.split(match[1]) == ["train", "--resume", "run with space"]
    steps = RunFolder(run).metrics()[-1]["steps"]
    config = run / "config.json"
    config.write_text(config.read_text().replace("1000000000", str(steps + 128)))
    assert main(shlex.split(match[1])) == 0
    assert RunFolder(run).metrics()[-1]["steps"] == steps + 128


@pytest.mark.slow
def test_a_signal_in_an_imitation_leaves_nothing_that_looks_finished(monkeypatch, ran):
    """It ends in the middle of a round, and the command that it prints begins anew."""
    rounds = []
    learn = imitation._Lessons.learn

    def interrupted(lessons, generator):
        rounds.append(lessons.rounds)
        if len(rounds) == 3:
            signal.raise_signal(signal.SIGINT)
        learn(lessons, generator)

    monkeypatch.setattr("rans.base.processes.processors", lambda: 1)
    monkeypatch.setattr(imitation._Lessons, "learn", interrupted)
    command = tiny(begin_from="pretrained:any-craft-2d", total_timesteps=256)
    said = ran("", *command, "--output", "run", code=130)
    assert rounds == [1, 1, 1]
    assert not {"checkpoint.safetensors", "agent.safetensors"} & {
        file.name for file in Path("run").iterdir()
    }
    assert "Stopped " in said
    assert said.endswith("Begin anew with: rans train --resume run")
    for name in ("_ROUNDS", "_OWN_ROUNDS", "_MOST_ROUNDS"):
        monkeypatch.setattr(imitation, name, 1)
    said = ran("train --resume run")
    assert "Stopped" not in said
    # Nobody arrives in flights of 4 s.
    assert "Nobody solves all of 256 starts: run (0 %), any-craft-2d#0.4 (0 %)" in said


def _iterate_for_ever() -> None:
    with StopGently() as stop:
        assert not stop()
        signal.raise_signal(signal.SIGINT)
        assert stop()
        for _ in range(1000):  # a signal just before a long sleep would wait for its end
            time.sleep(PATIENCE / 1000)


def test_an_iteration_that_does_not_end_is_interrupted(monkeypatch):
    monkeypatch.setattr(train, "_GENTLE", 0.05)
    before = signal.getsignal(signal.SIGALRM)
    with pytest.raises(KeyboardInterrupt):
        _iterate_for_ever()
    assert signal.getsignal(signal.SIGALRM) is before


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGUSR1"])
def test_one_that_ends_says_so_at_once_and_leaves_no_alarm(name, capfd):
    """Of a queue and its warning, and of a session that closes; what is ignored, as by nohup, stays so."""
    number = signal.Signals[name]
    usual = signal.signal(number, signal.SIG_DFL)  # nohup's own commands ignore SIGHUP
    with StopGently() as stop:
        assert not stop()
        signal.raise_signal(number)
        assert "stopping after this iteration" in capfd.readouterr().err
        assert stop.code == 128 + number
    # Before the first iteration has ended, as while kernels are compiled, nothing would be lost.
    with pytest.raises(KeyboardInterrupt), StopGently():
        signal.raise_signal(number)
    before = signal.signal(number, signal.SIG_IGN)
    with StopGently() as stop:
        signal.raise_signal(number)
        assert not stop.requested
    assert before == signal.SIG_DFL
    signal.signal(number, usual)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


@pytest.mark.usefixtures("undrawn")
def test_an_agent_that_comes_with_rans_is_trained_again_by_its_name():
    _, _, *options = tiny()
    more = "train go-to-pose-2d-shared --set total_timesteps=200 --seed=3"
    assert main([*more.split(), *options]) == 0
    config = read_config(Path("runs/go-to-pose-floating-platform-shared-seed3/config.json"))
    assert config.ppo.n_envs == 16
    assert config.ppo.schedule.anneal == 0.7


def test_whatever_is_set_is_learnt_from_nothing():
    assert Train("go-to-pose").begun().begin_from == "pretrained:any-craft-2d#0.4"
    assert Train("go-to-pose", seed=3, quality="quick").begun().begin_from is not None
    assert Train("go-to-pose", rl=True).begun().begin_from is None
    changes = (
        {"set": ("thrust_weight=0.1",)},
        {"total_timesteps": 1000},
        {"conditions": "lab"},
        {"quality": "good"},
        {"task": "go-to-position"},
    )
    for changed in changes:
        options = {"task": "go-to-pose"} | changed
        assert Train(**options).begun().begin_from is None, changed


def test_the_device_that_is_asked_for_trains(monkeypatch):
    """Whatever there is; also with the config of a run on another one."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert Train("go-to-pose").resolved().device == "cpu"
    assert Train("go-to-pose", device="cuda").resolved().device == "cuda"
    Path("config.json").write_text(json.dumps(to_table(Train("go-to-pose").resolved())))
    assert Train("config.json").resolved().device == "cpu"
    assert Train("config.json", device="cuda").resolved().device == "cuda"


@pytest.mark.slow
@pytest.mark.usefixtures("here", "undrawn")
def test_a_training_that_gained_nothing_says_so_and_leads_to_what_is_better(ran):
    """An imitation of the agent for any craft, which that dominates, or its value 0.5 at a smaller product."""
    said = ran("train go-to-pose --device cpu --output mine")
    taken = re.search(r"Take (\S+) \(", said)
    assert taken
    better = "mine" if taken[1] == "mine" else f"'{taken[1]}@mine/spacecraft.toml'"
    assert ("Nothing was gained" in said) is (taken[1] != "mine")
    assert said.partition("Next: ")[2].startswith(f"rans evaluate {better} ")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:any-craft-2d#0. solved")
@pytest.mark.usefixtures("undrawn")
def test_the_demo_trains_an_agent_where_others_lose_flights(tmp_path):
    """Its first training, of its craft like a boat: 99 % where any craft, LQR and switching solve 83, 64 and 38."""
    craft = Path(__file__).parents[2] / "examples/spacecraft/boat.toml"
    options = f"--spacecraft {craft} --rl --device cpu --output {tmp_path}/boat"
    assert main(["train", "go-to-pose", *options.split()]) == 0
    beside = (
        f"any-craft-2d@{craft}",
        f"lqr:go-to-pose-2d@{craft}",
        f"switching:go-to-pose-2d@{craft}",
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RansWarning)  # any craft says that it loses flights
        own, *others = (
            rans.evaluate(who, episodes=128)["solved"].value
            for who in (f"{tmp_path}/boat", *beside)
        )
    assert own > 95.0
    assert max(others) < 90.0
