"""What every test runs under, and the spacecraft that many of them fly."""

from __future__ import annotations

import gc
import io
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import gymnasium
import pytest
from hypothesis import settings

from rans.base.errors import EXTRAS, MissingPackage
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import TASKS
from tests.support.crafts import FREE_CRAFT, nasty_planar, nasty_spatial

# The same examples in every run, and no deadline: the machine may be busy.
settings.register_profile("rans", derandomize=True, deadline=None, database=None)
settings.load_profile("rans")
# Nor do examples depend on which modules are loaded, whose numbers Hypothesis 6.131 and later read for a second.
providers = sys.modules.get("hypothesis.internal.conjecture.providers")
if hasattr(providers, "_get_local_constants"):
    providers._get_local_constants = providers.Constants


# Libraries keep a million objects, which a search for garbage looks through: not while they are loaded, and seldom.
gc.disable()
gc.set_threshold(100_000, 20, 100)

# What one process compiled, tests with what their assertions show too, the others and later runs read.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Flights that choose how any craft is flown are flown once, and not those that a user's cache has.
os.environ["XDG_CACHE_HOME"] = str(Path(__file__).parent / ".pytest_cache" / "user")


def pytest_collection_finish() -> None:
    """What was imported stays."""
    gc.freeze()
    gc.enable()


READERS = {"ccsds_ndm", "distributed", "fmpy", "mcap_ros2"}
"""Libraries of the extra dev that only tests import."""


class Module(pytest.Module):
    """A file of tests, passed over where a library that it needs is not installed.

    Machines with a GPU often lack Drake and CasADi, and run what has the mark gpu.
    """

    def collect(self) -> Iterable[pytest.Item | pytest.Collector]:
        """See pytest."""
        try:
            return super().collect()
        except self.CollectError as error:
            cause = error.__cause__
            # RANS's own modules say what they lack; a test that imports a library itself gets Python's error.
            if isinstance(cause, MissingPackage):
                missing = cause.module
            else:
                missing = cause.name if isinstance(cause, ModuleNotFoundError) else None
            # Not one of its modules, which would be misspelt.
            if missing in {*EXTRAS, *READERS}:
                pytest.skip(f"needs {missing}", allow_module_level=True)
            raise


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module:
    """Every file of tests is a `Module`."""
    return Module.from_parent(parent, path=module_path)


class Refusals(pytest.File):
    """What a room refuses: its file ``refused.txt``, which is run with the tests of the room."""

    def collect(self) -> Iterable[pytest.Item]:
        """One test of all rows."""
        from tests.test_refusals import check_rows

        def sentences(here: Path) -> None:
            check_rows(self.path)

        yield pytest.Function.from_parent(self, name="sentences", callobj=sentences)


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> Refusals | None:
    """Tables of refusals are collected where they stand."""
    is_table = file_path.name == "refused.txt"
    return Refusals.from_parent(parent, path=file_path) if is_table else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave a single table of refusals out where the test of all tables is collected too."""
    if any(item.path.name == "test_refusals.py" for item in items):
        items[:] = [item for item in items if not isinstance(item.parent, Refusals)]


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    """One torch thread: small tensors gain nothing from more, and tests run side by side."""
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


@pytest.fixture(autouse=True)
def _environment_of_others() -> Iterator[None]:
    """A test that leaves variables of RANS or Python behind fails, and those after it run without them."""
    before = _variables()
    yield
    after = _variables()
    for name in before.keys() | after.keys():
        os.environ.pop(name, None)
    os.environ.update(before)
    assert after == before, (
        "the test left the environment changed; monkeypatch.setenv undoes changes"
    )


@pytest.fixture(autouse=True)
def _names_of_others() -> Iterator[None]:
    """Names that a test types, whose code may then run, are not typed for the tests after it."""
    registry = sys.modules.get("rans.base.registry")
    before = set() if registry is None else set(registry._typed)
    yield
    if registry is not None:
        registry._typed.intersection_update(before)


@pytest.fixture(scope="session", autouse=True)
def _few_flights_of_exports() -> Iterator[None]:
    """Ranges of exports are those of 64 flights of 8 s, as many as golden pairs need: thousands take 12 seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rans.deploy.export.FLIGHTS", 64)
        patch.setattr("rans.deploy.contract.STEPS", 40)
        yield


def _variables() -> dict[str, str]:
    """Those that say how RANS and Python behave, such as ``RANS_TRUST`` and ``PYTHONSAFEPATH``."""
    return {
        name: value for name, value in os.environ.items() if name.startswith(("RANS_", "PYTHON"))
    }


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder whose training was stopped after two iterations; a test that writes takes a copy."""
    from tests.support.training import after, ignore, tiny_trainer

    path = tmp_path_factory.mktemp("runs") / "first"
    tiny_trainer(path).train(ignore, after(2))
    return path


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of the test's own, which is the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs a command, a line and perhaps words with spaces, that must end with code 2; its one sentence.

    On a busy machine a stage of a second has a line before it.
    """
    from rans.cli import main

    def run(line: str, *words: str) -> str:
        capsys.readouterr()
        assert main([*line.split(), *words]) == 2
        told = capsys.readouterr()
        assert told.out == ""
        assert sum(not one.endswith(" ...") for one in told.err.splitlines()) == 1
        return told.err

    return run


@pytest.fixture
def ran(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs a command, a line and perhaps words with spaces; all that it prints, with one space between words."""
    from rans.cli import main

    def run(line: str, *words: str, code: int = 0) -> str:
        capsys.readouterr()
        assert main([*line.split(), *words]) == code
        said = capsys.readouterr()
        return " ".join((said.out + said.err).split())

    return run


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made, but not drawn: that takes a second each, and the test looks at something else."""
    monkeypatch.setattr("matplotlib.figure.Figure.draw_without_rendering", lambda _: None)
    monkeypatch.setattr(
        "matplotlib.figure.Figure.savefig",
        lambda _, file, **__: (
            file.write('<svg xmlns="http://www.w3.org/2000/svg"/>')
            if isinstance(file, io.StringIO)
            else None
        ),
    )


@pytest.fixture(params=FREE_CRAFT)
def shipped(request: pytest.FixtureRequest) -> Spacecraft:
    """Every spacecraft that comes with the package and flies every task."""
    return load_spacecraft(request.param)


@pytest.fixture
def planar_craft() -> Spacecraft:
    """See `tests.support.crafts.nasty_planar`."""
    return nasty_planar()


@pytest.fixture
def spatial_craft() -> Spacecraft:
    """See `tests.support.crafts.nasty_spatial`."""
    return nasty_spatial()


@pytest.fixture
def forgotten(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Tasks that a test registers are unknown to the next one."""
    monkeypatch.setattr(TASKS, "own", {})
    before = set(gymnasium.registry)
    yield
    for added in set(gymnasium.registry) - before:
        del gymnasium.registry[added]
