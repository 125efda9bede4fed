"""Options that are treated alike in all commands: former ones, repeated ones, and those with a number."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rans.cli import _parse, main
from rans.cli.compare import Compare
from rans.cli.options import in_present_words, with_numbers_named
from rans.errors import ConfigError
from tests.support.command_runs import tiny


@pytest.mark.parametrize("second", [["--certified", "4"], ["--certified=4"]])
def test_an_option_twice_is_told(
    second: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The last counts, as everywhere: whoever has an alias may go on."""
    assert (
        main(
            ["compare", "pretrained:nobody", "--certified", "3", *second, "--output", str(tmp_path)]
        )
        == 2
    )
    assert (
        "warning: '--certified' is given twice; the last value is used" in capsys.readouterr().err
    )


def test_a_former_option_is_accepted_with_the_present_one_in_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    former = ["--set=total_timesteps=64", "--algorithm=ppo", "--run", str(run), "--plain"]
    assert main([*tiny(), *former]) == 0
    told = capsys.readouterr().err
    for option, present in (
        ("--algorithm", "write --set algorithm=NAME"),
        ("--run", "write --output FOLDER"),
        ("--plain", "write --set plain=true"),
    ):
        assert f"rans: warning: {option} of rans train is deprecated" in told
        assert f": {present}." in told
    config = json.loads((run / "config.json").read_text())
    assert config["plain"] is True


@pytest.mark.parametrize(
    ("former", "present"),
    [
        ("train --seed 3 --config runs/a/config.json", "runs/a/config.json --seed 3"),
        ("train hold --terms --seed=3", "hold --log terms --seed=3"),
        ("sweep hold --total-timesteps=1e6", "hold --set total_timesteps=1e6"),
        ("optimal dock --keep-out 1,1,0.2 2,2,0.2", "dock --zones 1,1,0.2 2,2,0.2"),
        ("view a --page fly.html", "a --play --save fly.html"),
        ("init mine.toml --thrust_sharing split", "mine.toml --set thrust_sharing=split"),
    ],
)
def test_former_options_become_present_words(former: str, present: str) -> None:
    name, *words = former.split()
    with pytest.warns(DeprecationWarning, match=f"of rans {name} is deprecated"):
        assert in_present_words(name, words) == present.split()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize(
    "words", ["--video a.mp4 --frames a.png", "--frames a.png --save a.mp4", "--save a --frames b"]
)
def test_a_present_option_has_one_value(words: str) -> None:
    with pytest.raises(ConfigError, match=r"--frames is the former word of --save"):
        in_present_words("view", ["a", *words.split()])


def test_words_that_are_no_former_options_stay() -> None:
    """A former switch takes no value, and a former option without its value is the parser's to refuse."""
    for words in (["a", "--plain=yes"], ["a", "--run"], ["a", "--set", "plain=true"]):
        assert in_present_words("train", words) == words
    assert in_present_words("compare", ["a", "--plain"]) == ["a", "--plain"]


def test_a_number_may_follow_the_guard_and_a_run_too() -> None:
    assert with_numbers_named(Compare, ["--guard", "0.01", "--seed", "3"]) == [
        "--guard",
        "--guard-slack=0.01",
        "--seed",
        "3",
    ]
    assert with_numbers_named(Compare, ["--guard", "runs/first"]) == ["--guard", "runs/first"]


@pytest.mark.parametrize(
    ("command", "former"),
    [
        ("optimal go-to-pose --zones 1,1,0.3 --keep-out 1,1,0.2", "--keep-out"),
        ("init mine --set size=0.3 mass=3 --mass=4", "--mass"),
    ],
)
def test_a_former_option_beside_its_present_one_is_refused(
    command: str, former: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(command.split()) == 2
    assert f"leave {former} out" in capsys.readouterr().err


def test_a_number_has_no_option_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    """It goes with the option before it, and is read nowhere else."""
    command = _parse(["compare", "go-to-pose-2d", "--guard", "0.2"])
    assert (command.guard, command.guard_slack) == (True, 0.2)
    assert main(["compare", "go-to-pose-2d", "--guard", "--guard-slack", "0.2"]) == 2
    assert "has no option --guard-slack" in capsys.readouterr().err
