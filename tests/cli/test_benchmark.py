from __future__ import annotations

import json

import pytest

from rans import TASKS
from rans.base.terminal import Terminal
from validation.commands.benchmark import Benchmark
from validation.speed.measurement import Measurement


@pytest.fixture(autouse=True)
def _wide(monkeypatch) -> None:
    """Tables are as wide as they need to be."""
    monkeypatch.setenv("COLUMNS", "240")


@pytest.fixture(autouse=True)
def _small(monkeypatch) -> None:
    """One batch of 64 on the CPU, also where there is a GPU."""
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    monkeypatch.setattr("validation.speed.measured._QUICK_SIZES", {"cpu": (64,)})


QUICK = ["floating-platform", "--quick"]


def test_interrupted_it_shows_and_writes_what_was_measured(ran, tmp_path, monkeypatch):
    """Ctrl-C comes while the first agent is timed."""

    def measured(*_):
        yield Measurement("memory", "memory copy", 12.5, "GB/s")
        yield Measurement(
            "engine",
            "7 environments",
            3.0,
            "M steps/s",
            bound=4.0,
            bound_name="what the copy bandwidth allows to it",
        )
        yield Measurement("policy", "one that could not be made", None, "us", note="no ONNX")
        raise KeyboardInterrupt

    monkeypatch.setattr("validation.speed.suite.measurements", measured)
    monkeypatch.setenv("COLUMNS", "60")
    file = tmp_path / "speed.json"
    said = ran("benchmark", *QUICK, "--output", str(file), code=130)
    assert "12.5" in said
    assert "0.75" in said  # its share of the bound, also on a narrow terminal
    assert "interrupted; what was written is kept" in said
    assert [row["value"] for row in json.loads(file.read_text())["measurements"]] == [
        12.5,
        3.0,
        None,
    ]


def test_without_a_compiler(refused, monkeypatch):
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setenv("PATH", "/nowhere")
    assert "needs a C++ compiler" in refused("benchmark")


@pytest.mark.parametrize(
    ("device", "quick", "expected"),
    [
        ("cpu", False, (1024, 16_384, 262_144)),
        ("cuda", False, (16_384, 262_144, 4_194_304)),
        ("cpu", True, (64,)),
    ],
)
def test_sizes(device, quick, expected, monkeypatch):
    """What was asked for, or what its help promises."""
    asked = []
    monkeypatch.setattr(
        "validation.speed.suite.measurements", lambda *given: asked.append(given) or ()
    )
    Benchmark(quick=quick)._measure(Terminal(), device, [])
    [(crafts, name, task, sizes, _)] = asked
    assert sizes == expected
    assert ([craft.name for craft in crafts], name) == (
        ["floating-platform", "free-flyer"],
        "go-to-pose",
    )
    assert isinstance(task, TASKS["go-to-pose"])
