"""Hyper-parameters known to solve each task; how they were found is in docs/decisions/005-presets.md."""

from __future__ import annotations

from rans.fast.config import PPOSettings

_CPU = PPOSettings()
_GPU = PPOSettings(n_envs=512, batch_size=8192, layers=(128, 128))

PRESETS: dict[tuple[str, int, str], PPOSettings] = {
    ("go-to-pose", 2, "cpu"): _CPU,
    ("go-to-pose", 2, "cuda"): _GPU,
    ("go-to-pose", 3, "cpu"): PPOSettings(n_envs=256, batch_size=4096, layers=(256, 256, 256), activation="elu"),
    ("go-to-pose", 3, "cuda"): PPOSettings(
        n_envs=8192, n_steps=16, batch_size=32_768, layers=(256, 256, 256), activation="elu",
        learning_rate=3e-4),
}
"""By task, dimension and kind of device."""


def preset(task: str, dimension: int, device: str) -> PPOSettings:
    """The known-good settings; on another kind of device those for a GPU."""
    kind = "cpu" if device.startswith("cpu") else "cuda"
    return PRESETS[task, dimension, kind]
