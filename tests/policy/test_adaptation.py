"""Where no package has an estimator, an agent that would adapt says which one is needed."""

from __future__ import annotations

import pytest

from rans.errors import ConfigError
from rans.evaluation.fly.contestants import contestant
from rans.policy.adaptation import ESTIMATORS


@pytest.mark.parametrize("name", ["adaptive:any-craft-2d", "adaptive:any-craft-3d@spheres"])
def test_without_the_package_its_extra_is_named(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ESTIMATORS, "_offered", {})
    with pytest.raises(ConfigError, match=r"pip install 'rans\[any_craft\]'"):
        contestant(name)
