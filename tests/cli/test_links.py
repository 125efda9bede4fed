"""A folder of a stranger with symbolic links in it: nothing outside is written, and a sentence says why."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from rans.cli import main

FLOWN = "--episodes", "2", "--seed", "1"


@pytest.fixture
def run(trained, tmp_path, monkeypatch) -> Path:
    """A copy in the current folder."""
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copytree(trained, "run"))


@pytest.mark.parametrize(
    ("command", "place"),
    [
        *(
            ("evaluate run --episodes 2", name)
            for name in ("config.json", "agent.safetensors", "evaluation.json")
        ),
        *(
            ("train --resume run", name)
            for name in ("metrics.jsonl", "checkpoint.safetensors", ".lock")
        ),
        ("compare run --with --certified 0 --episodes 2", "compare-bounds.json"),
        ("assure run --episodes 8", "assurance.json"),
        ("export run --output shipped --force", "metrics.jsonl"),
        ("report run", "evaluation-of-a-stranger.json"),
        ("report run", "compare.json"),
    ],
)
def test_a_file_that_is_a_link_is_refused(run, command, place, refused):
    """Before anything is read from it or added to it; a copy would do what the link does, if it could."""
    link = run / place
    outside = Path("outside")
    shutil.copy(link, outside) if link.exists() else outside.write_text("mine")
    before = outside.read_bytes()
    link.unlink(missing_ok=True)
    link.symlink_to(outside.absolute())
    assert f"{os.path.normpath(link)} is a symbolic link" in refused(command)
    assert outside.read_bytes() == before


@pytest.mark.parametrize(
    ("command", "place"),
    [
        ("train --resume run", "tensorboard"),
        ("stress run --episodes 2 --only latency", "stress"),
    ],
)
def test_a_folder_that_is_a_link_is_refused(run, command, place, refused):
    outside = Path("outside")
    outside.mkdir()
    link = run / place
    shutil.rmtree(link, ignore_errors=True)
    link.symlink_to(outside.absolute())
    assert f"{os.path.normpath(link)} is a symbolic link" in refused(command)
    assert not list(outside.iterdir())


def test_a_link_among_the_events_is_refused(run, refused):
    """TensorBoard's writer opens files by names that can be foreseen."""
    (run / "tensorboard" / "events.out.tfevents.1.host.2.0").symlink_to(Path("outside").absolute())
    assert "is a symbolic link" in refused("train --resume run")
    assert not Path("outside").exists()


@pytest.mark.usefixtures("undrawn")
def test_a_folder_full_of_links_has_nothing_written_elsewhere(run):
    """By the names that drafts had; and links in the place of results are replaced, not followed."""
    outside = Path("outside")
    outside.write_text("mine")
    results = "evaluation.json", "episodes.npz", "evaluation.svg", "episode.svg"
    for name in results:
        (run / f".{os.getpid()}.{name}").symlink_to(outside.absolute())
    for name in results[1:]:
        (run / name).symlink_to(outside.absolute())
    assert main(["evaluate", "run", *FLOWN]) == 0
    assert outside.read_text() == "mine"
    assert not any((run / name).is_symlink() for name in results)


@pytest.mark.usefixtures("undrawn")
def test_a_run_folder_may_be_a_link_itself(run):
    """Somebody typed its name."""
    Path("short").symlink_to(run.absolute())
    assert main(["evaluate", "short", *FLOWN]) == 0
    assert (run / "evaluation.json").exists()
