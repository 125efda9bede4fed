"""Engines whose generated kernel runs on the CPU."""

from tests.support.host_kernels import engine_on_host  # noqa: F401  (a fixture)
