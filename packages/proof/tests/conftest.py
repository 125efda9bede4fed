"""Tests of proofs check their small certificates in their own process."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def here(monkeypatch) -> None:
    """A certificate of a test is small, and a process would take longer than its check."""
    monkeypatch.setattr("rans.base.processes.processors", lambda: 1)
