"""An agent as a module of Basilisk: its frames by hand, golden pairs through messages, and flights."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rans.base.pretrained import pretrained_folder
from rans.base.registry import typed
from rans.deploy.export import write_export
from rans.extend import is_installed

AGENT = pretrained_folder("go-to-pose-3d")
FORM = typed("rans_missions.basilisk_module:write_basilisk")
PERIOD = 200_000_000
"""Control period, ns."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("basilisk")
    write_export(AGENT, folder, FORM, episodes=8)
    return folder


@pytest.fixture
def file(folder, monkeypatch) -> Any:
    """The exported file as a module."""
    if not is_installed("Basilisk"):  # frames are tested without it
        parts: Any = SimpleNamespace(messaging=None, sysModel=SimpleNamespace(SysModel=object))
        monkeypatch.setitem(sys.modules, "Basilisk.architecture", parts)
    monkeypatch.syspath_prepend(folder)
    return importlib.import_module("agent_basilisk")


def send(module: Any, now: float, own: dict[str, Any], goal: dict[str, Any]) -> None:
    """Let a module have messages of a state and of a goal that does not move, as golden.json has them."""
    messaging = importlib.import_module("Basilisk.architecture.messaging")

    def message(name: str, **fields: Any) -> Any:
        return getattr(messaging, name)().write(getattr(messaging, f"{name}Payload")(**fields))

    sigma, sigma_goal = (
        Rotation.from_quat(one["attitude"], scalar_first=True).as_mrp() for one in (own, goal)
    )
    p, v, w = (own[name] for name in ("position", "velocity", "spin"))
    attitude = message("NavAttMsg", timeTag=now, sigma_BN=sigma, omega_BN_B=w)
    module.navAttInMsg.subscribeTo(attitude)
    module.navTransInMsg.subscribeTo(message("NavTransMsg", timeTag=now, r_BN_N=p, v_BN_N=v))
    module.attRefInMsg.subscribeTo(message("AttRefMsg", sigma_RN=sigma_goal))
    module.transRefInMsg.subscribeTo(message("TransRefMsg", r_RN_N=goal["position"]))


def test_frames_by_hand(file):
    """A quarter about z lets B's x point along N's y; a third about the diagonal turns x to y and y to z."""
    quarter = file.rotation((0.0, 0.0, np.sqrt(2.0) - 1.0))
    np.testing.assert_allclose(quarter[:, 0], (0.0, 1.0, 0.0), atol=1e-15)
    third = np.full(3, 1.0 / 3.0)
    for same in (third, -third / (third @ third)):  # and its shadow set
        np.testing.assert_allclose(file.rotation(same), np.eye(3)[[2, 0, 1]], atol=1e-15)


def test_golden_pairs_through_messages(file, folder):
    pytest.importorskip("Basilisk")
    module = file.AgentModule()
    pairs = json.loads((folder / "golden.json").read_text("utf-8"))
    rows = zip(*(pairs[name] for name in ("begins", "state", "goal", "command")), strict=True)
    for k, (begins, own, goal, command) in enumerate(rows):
        if begins:
            module.Reset(k * PERIOD)
        send(module, k * 0.2, own, goal)
        for now in (k * PERIOD, k * PERIOD + 1):  # the second changes nothing
            module.UpdateState(now)
            on_times = module.onTimeOutMsg.read().OnTimeRequest[: len(command)]
            np.testing.assert_array_equal(on_times, np.array(command) * 0.2)
    assert k == 499
    module.UpdateState((k + 3) * PERIOD)  # readings are old
    assert not any(module.onTimeOutMsg.read().OnTimeRequest)
