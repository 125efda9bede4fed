"""The campaign at a tiny size, and whether it would see what it is there for."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from campaigns.breaking import __main__ as campaign
from campaigns.breaking import steps, training, trial
from campaigns.breaking.__main__ import Breaking, Tally
from campaigns.breaking.cases import file_case, folder_case, line_case, tiny, trained, under
from campaigns.breaking.damage import damaged_bytes, damaged_text
from campaigns.breaking.steps import extreme
from campaigns.breaking.trial import Outcome, apart, ran
from rans.cli import COMMANDS
from rans.fast.engine import Engine
from rans.fast.learn.run_folder import read_config
from rans.fast.stepping.step import Step
from rans.model.spacecraft_file import load_spacecraft, spacecraft_text
from rans.model.timing import Timing
from rans.randomization.conditions_file import load_conditions


def test_tiny(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A config and some steps; the rest takes seconds each."""
    tiny = Breaking(1, 0, 0, 0, 0, 1e4, first=3, output=tmp_path / "out.json")
    assert tiny.run() == 0
    found = json.loads((tmp_path / "out.json").read_text())
    assert found["files"]["tried"] == 1
    assert sum(found["files"]["endings"].values()) == 1
    assert found["steps"]["steps"] >= 1e4
    assert found["faults"] == 0
    assert "how commands ended" in capsys.readouterr().out


def _raises() -> int:
    raise KeyError("x")


def _sleeps() -> int:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    time.sleep(60)
    return 0


def _waits() -> int:
    try:
        time.sleep(60)
    except KeyboardInterrupt:
        return 130
    return 0


def _dies() -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


def _says(text: str, code: int) -> Callable[[], int]:
    def say() -> int:
        sys.stderr.write(text)
        return code

    return say


ENDINGS: dict[str, tuple[Callable[[], int], str, list[str]]] = {
    "raises": (_raises, "traceback", ["traceback"]),
    "sleeps": (_sleeps, "hang", ["hang"]),
    "waits": (_waits, "interrupted", []),
    "dies": (_dies, "died", ["died"]),
    "odd code": (lambda: 7, "died", ["died"]),
    "sentence": (_says("rans: no.", 2), "refused", []),
    "silence": (_says("", 2), "refused", ["refused without a word"]),
    "escapes": (_says("\x1b[31m", 2), "refused", ["escape codes"]),
    "endless": (_says("x" * 40_000, 2), "refused", ["endless error"]),
    "fine": (lambda: 0, "done", []),
    "exits": (lambda: sys.exit(2), "refused", ["refused without a word"]),
    "memory": (lambda: len(bytearray(2**36)), "traceback", ["traceback"]),
}


@pytest.mark.parametrize("name", ENDINGS)
def test_every_way_to_end_is_seen(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, ending, faults = ENDINGS[name]
    monkeypatch.setattr(trial, "main", run)
    monkeypatch.setattr(trial, "LEAVE", 0.3)
    found = ran(("x",), tmp_path, patience=0.3)
    assert (found.ended, found.faults) == (ending, faults)


COMMANDS_TWICE = """
import json, sys
from dataclasses import asdict
from pathlib import Path
from campaigns.breaking.trial import ran
for line in sys.argv[2:]:
    for fresh in (None, ""):
        print(json.dumps(asdict(ran(line.split(), Path(sys.argv[1]), fresh=fresh))))
"""


@pytest.mark.slow
def test_a_fork_says_what_a_process_started_from_nothing_says(tmp_path: Path) -> None:
    """The parent is a process of its own: forks of this one would also list what other tests have registered."""
    lines = ("evaluate nobody", "list --help")
    folder = _new(tmp_path / "folder")
    done = subprocess.run(
        [sys.executable, "-c", COMMANDS_TWICE, folder, *lines],
        capture_output=True,
        text=True,
        check=True,
    )
    outcomes = [json.loads(line) for line in done.stdout.splitlines()]
    for fork, fresh in zip(outcomes[::2], outcomes[1::2], strict=True):
        assert [fork[key] for key in ("command", "ended", "out", "err")] == [
            fresh[key] for key in ("command", "ended", "out", "err")
        ]
        assert fork["out"] + fork["err"]
        assert (fork["fresh"], fresh["fresh"]) == (False, True)
    assert len(outcomes) == 2 * len(lines)


@pytest.mark.slow
def test_limits_and_what_is_asked_for_reach_a_process_started_from_nothing(tmp_path: Path) -> None:
    seen = (
        "import os, resource, sys; print(os.getcwd(), resource.getrlimit(resource.RLIMIT_AS)[0], "
        "sys.stdin.read(), 'torch' in sys.modules, sys.argv[1:])"
    )
    told = ran(("list", "--json"), tmp_path, fresh=seen)
    assert told.out.startswith(f"{tmp_path} {8 * 2**30}  False ['list', '--json']\n{{")
    assert told.ended == "done"
    assert ran(("list",), tmp_path, fresh="raise SystemExit(7)").ended == "died"


def test_one_started_from_nothing_that_hangs_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trial, "LEAVE", 0.3)
    deaf = "import signal, time; signal.signal(2, signal.SIG_IGN); time.sleep(60)"
    assert ran(("list",), tmp_path, patience=1.0, fresh=deaf).ended == "hang"


def test_what_this_process_lets_another_do_leaves_nothing_here() -> None:
    apart(os.environ.__setitem__, "RANS_LEFT", "1")
    assert "RANS_LEFT" not in os.environ
    with pytest.raises(AssertionError, match="ended with 7"):
        apart(sys.exit, 7)


def test_a_share_is_started_from_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def noted(command: tuple[str, ...], *_: Any, fresh: str | None) -> Outcome:
        return Outcome(command, "done", 0.0, "", "", fresh is not None)

    monkeypatch.setattr(campaign, "ran", noted)
    for share, least, most in ((0.0, 0, 0), (0.2, 4, 16), (1.0, 40, 40)):
        trial = Breaking(fresh=share)._trial("files", tmp_path)
        found = [
            trial(number, _new(tmp_path / f"{share}-{number}"))[0][0].fresh for number in range(40)
        ]
        assert least <= sum(found) <= most


def test_a_fault_fails_and_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    broken = Outcome(("list", "odd.toml"), "traceback", 0.1, "", "Traceback")
    monkeypatch.setattr(campaign, "ran", lambda *_, **__: broken)
    assert Breaking(files=1, lines=0, folders=0, kills=0, disks=0, steps=0).run() == 1
    assert "files:0 traceback: list odd.toml" in capsys.readouterr().err
    tally = Tally()
    tally.add(4, [], ["another agent"])
    assert tally.faults == [{"case": 4, "command": [], "fault": "another agent", "said": ""}]


@pytest.mark.parametrize("run", [steps.steps, steps.compiled_steps])
def test_numbers_that_are_silently_none_are_counted(
    run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One in an observation, one in a reward, one in a term; a state that is lost and told is not silent."""

    class Sick:
        def __init__(self, craft: Any, _: Any, num_envs: int, *__: Any, **___: Any) -> None:
            self.craft = craft
            self.num_envs = num_envs

        def step(self, action: torch.Tensor) -> Any:
            observation = torch.zeros(8, 10)
            final = torch.zeros(8, 10)
            reward = torch.zeros(8)
            terms = torch.zeros(3, 8)
            observation[3, 9] = reward[1] = terms[2, 5] = final[2] = final[6] = torch.nan
            ended = torch.arange(8) == 2
            return Step(
                observation, reward, ended, torch.zeros(8, dtype=torch.bool), final, ended, terms
            )

    monkeypatch.setattr(steps, "Engine", Sick)
    found = run(8 * 64)
    assert (found.steps, found.silent, found.lost) == (8 * 64, 3 * 64, 64)
    assert found.where == (1,)


def test_cases_follow_from_their_number(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    (run / "metrics.jsonl").write_text('{"steps": 1}\n' * 9)
    for k, make in enumerate(
        (file_case, lambda n, f: line_case(n, f, run), lambda n, f: folder_case(n, f, [run, run]))
    ):
        once = tmp_path / f"{k}a"
        again = tmp_path / f"{k}b"
        for folder in (once, again):
            folder.mkdir()
        assert make(7, once) == make(7, again)
        assert [x.name for x in sorted(once.iterdir())] == [x.name for x in sorted(again.iterdir())]
    assert {line_case(n, _new(tmp_path / f"l{n}"), run)[0][0] for n in range(len(COMMANDS))} <= {
        *COMMANDS,
        *line_case.__globals__["_WORDS"],
    }


def _new(folder: Path) -> Path:
    folder.mkdir()
    return folder


def test_commands_that_take_conditions_get_them() -> None:
    asked = [
        ("evaluate", "run"),
        ("evaluate", "run", "--conditions", "lab"),
        ("train", "--resume", "run"),
        ("report", "run"),
        (),
        ("no such",),
    ]
    assert under("harsh", asked) == [("evaluate", "run", "--conditions", "harsh"), *asked[1:]]
    assert under("", asked) == asked


@pytest.mark.slow
def test_trainings_take_place_under_them(tmp_path: Path) -> None:
    one = tmp_path / "one"
    trained(one, tiny("harsh"))
    assert read_config(one / "config.json").conditions == load_conditions("harsh")
    assert read_config(one / "config.json").ppo.privileged_critic


def test_every_craft_meets_all_conditions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twelve worlds of equal size, each of another pair; no conditions are one of the sets."""
    met: list[tuple[str, str | None]] = []

    class Noted:
        def __init__(
            self, craft: Any, _: Any, num_envs: int, *__: Any, conditions: Any, **___: Any
        ) -> None:
            self.craft = craft
            self.num_envs = num_envs
            met.append((craft.name, conditions and conditions.description))

        def step(self, action: torch.Tensor) -> Any:
            assert action.shape == (4, len(self.craft.thrusters))
            zeros = torch.zeros(4)
            never = torch.zeros(4, dtype=torch.bool)
            return Step(
                torch.zeros(4, 10),
                zeros,
                never,
                never,
                torch.zeros(4, 10),
                never,
                torch.zeros(3, 4),
            )

    monkeypatch.setattr(steps, "Engine", Noted)
    monkeypatch.setattr(steps, "_BATCH", 4)
    assert steps.compiled_steps(12 * 64, under=["", "lab", "harsh"]).steps == 12 * 64
    assert len(set(met)) == len(met) == 12


def test_damage_damages() -> None:
    text = spacecraft_text("floating-platform")
    chance = random.Random(1)
    changed = [damaged_text(text, chance) for _ in range(50)]
    assert sum(one != text for one in changed) > 40
    assert len(set(changed)) > 40
    assert sum(damaged_bytes(text.encode(), chance) != text.encode() for _ in range(50)) > 45


def test_extreme_craft_are_allowed_ones() -> None:
    """They are at the ends of what files may say, or steps would try nothing."""
    craft = [extreme(random.Random(k)) for k in range(30)]
    assert min(one.mass for one in craft) < 1e-3
    assert max(one.mass for one in craft) > 1e6


def test_bodies_are_as_extreme_and_each_another() -> None:
    craft = load_spacecraft("free-flyer")
    with pytest.warns(UserWarning, match="can hardly be controlled"):
        # Which must be rigid, and none of them moved further in a period than is flown.
        engine = Engine(craft, "go-to-pose", 500, body=steps.bodies(craft, 500, 1, 0.2))
    masses = np.asarray(engine.body.mass)
    assert masses.min() < 1e-3
    assert masses.max() > 1e6
    assert len(np.unique(masses)) > 200


@pytest.mark.filterwarnings("ignore:spacecraft '.*' can hardly be controlled")
@pytest.mark.parametrize(
    "craft", ["floating-platform", "free-flyer", "floating-platform-shared", "atmos"]
)
@pytest.mark.parametrize("period", [1e-3, 0.2, 5.0])
def test_no_world_of_extreme_bodies_is_refused(craft: str, period: float) -> None:
    """Else a campaign would look for one without an end."""
    known = load_spacecraft(craft)
    for seed in range(5):
        extreme_ones = steps.bodies(known, 500, seed, period)
        assert (
            Engine(known, "go-to-pose", 500, Timing(period, substeps=1), body=extreme_ones).num_envs
            == 500
        )


def test_another_agent_is_seen(tmp_path: Path) -> None:
    """By its rows, and by any bit of its weights."""
    whole = training.Left({"a": 1}, b"12", [{"steps": 1}])
    for other in (
        whole._replace(numbers=b"13"),
        whole._replace(rows=[]),
        whole._replace(header={}),
    ):
        assert other != whole
    assert not training._ended(tmp_path, [], whole).equal  # nothing is left there
