"""Problems and efforts of certificates."""

from __future__ import annotations

import pytest

from rans.errors import ConfigError
from rans.optimal.certificate.problem import SearchEffort


def test_effort_refuses() -> None:
    with pytest.raises(ConfigError, match="effort"):
        SearchEffort(work=0.0)
