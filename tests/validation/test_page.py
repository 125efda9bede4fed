"""The page on validation counts what the command checks."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from rans.cli import main

PAGE = Path(__file__).parents[2] / "docs" / "validation.md"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pingu", "innocube"])
def test_the_page_counts_the_checks_of_a_quick_validation(name, tmp_path):
    assert main(["validate", name, "--quick", "--output", str(tmp_path)]) == 0
    written = json.loads((tmp_path / "validation.json").read_text("utf-8"))
    (said,) = re.findall(rf"`{name}` \((\d+)\)", PAGE.read_text("utf-8"))
    assert len(written["checks"]) == int(said)
