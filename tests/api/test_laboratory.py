"""Whose `validation` the commands run."""

import pytest

from tests.support.processes import printed


@pytest.mark.slow
def test_a_users_own_validation_is_not_run(tmp_path):
    (tmp_path / "validation.py").write_text("raise SystemExit('the wrong one')")
    line = "-m rans validate --quick --layer thrusters"
    assert "checks passed" in printed(*line.split(), cwd=tmp_path)
