"""Errors as Python's own protocols expect them, and where one of a user's code was raised."""

import pytest

from rans import TASKS, GoToPosePriced
from rans.base import errors
from rans.evaluation.measure.aggregate import Metrics
from rans.tasks.go_to_pose_priced import TradeOffPositions
from tests.support.scripts import module_of


def test_a_users_file_beside_the_package_is_not_the_packages(tmp_path, monkeypatch):
    """A name that begins as the package's folder does, as of a project that extends it."""
    monkeypatch.setattr(errors, "__file__", str(tmp_path / "rans" / "errors.py"))
    file = tmp_path / "rans_mine.py"
    file.write_text("def act():\n    raise LookupError(3)\n", encoding="utf-8")
    module = module_of(file)
    with pytest.raises(LookupError, match="3") as raised:
        module.act()
    assert errors.where_raised(raised.value) == " (rans_mine.py, line 2, in act)"


@pytest.mark.parametrize(
    "names",
    [TASKS, TradeOffPositions(GoToPosePriced()), Metrics("c", "fast", "s", 1, 1, 0.2, ())],
    ids=lambda names: type(names).__name__,
)
@pytest.mark.parametrize("key", ["nothing", None])
def test_mappings_are_asked_as_pythons(names, key):
    assert names.get(key) is None
    assert key not in names
    with pytest.raises(errors.NoSuchKey) as raised:
        names[key]
    assert repr(key) in str(raised.value)
    assert str(raised.value).endswith(".")
