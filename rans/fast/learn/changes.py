"""Changes to a training's config by the names of its entries, as options and keyword arguments give them."""

from __future__ import annotations

import difflib
import warnings
from collections.abc import Iterator, Mapping
from typing import Any

from rans.errors import ConfigError, brief

_OTHERS_NAMES = {
    "lr": "ppo.learning_rate",
    "num_envs": "ppo.n_envs",
    "num_steps": "ppo.n_steps",
    "horizon_length": "ppo.n_steps",
    "minibatch_size": "ppo.batch_size",
    "mini_epochs": "ppo.n_epochs",
    "num_epochs": "ppo.n_epochs",
    "epochs": "ppo.n_epochs",
    "lam": "ppo.gae_lambda",
    "clip": "ppo.clip_range",
    "clip_param": "ppo.clip_range",
    "e_clip": "ppo.clip_range",
    "entropy_coef": "ppo.ent_coef",
    "entropy": "ppo.ent_coef",
    "target_kl": "ppo.desired_kl",
    "kl_threshold": "ppo.desired_kl",
    "net_arch": "ppo.layers",
    "hidden_sizes": "ppo.layers",
    "total_steps": "total_timesteps",
    "timesteps": "total_timesteps",
    "max_episode_steps": "timing.episode_steps",
    "dt": "timing.control_period",
}
"""What SB3, CleanRL, rl_games, rsl_rl and Gymnasium call an entry."""
_FORMER_NAMES = {
    "timing.looks": "timing.checks",
    "failures.looks": "failures.searches",
    "settings.verge_weight": "settings.boundary_weight",
    "settings.arrived_squarings": "settings.arrived_sharpness",
    "settings.knob": "settings.trade_off",
}
"""Names of entries in the version before, which work for one version more and warn."""
_NEAR = 0.7
"""Likeness of a name from which on it is suggested."""


def change_entry(table: dict[str, Any], name: str, value: Any) -> None:
    """Give one entry of a nested table another value.

    Args:
        table: a config as `rans.fast.learn.config.to_table` gives it.
        name: of the entry from the top, as ``ppo.learning_rate``; or its last part alone, where only one entry
            is called so.
        value: new value.

    Raises:
        ConfigError: there is no such entry, or several end in this name.
    """
    known = list(_names(table))
    former = [old for old in _FORMER_NAMES if old == name or old.endswith(f".{name}")]
    if name not in known and len(former) == 1 and _FORMER_NAMES[former[0]] in known:
        new = _FORMER_NAMES[former[0]]
        warnings.warn(
            f"{name} is deprecated and goes with the next version: name it {new}.",
            DeprecationWarning,
            stacklevel=2,
        )
        name = new
    result = [name] if name in known else [one for one in known if one.endswith(f".{name}")]
    if len(result) > 1:
        raise ConfigError(
            f"several entries of the config are called {brief(name)}: choose one of {', '.join(result)}."
        )
    if not result:
        raise ConfigError(
            f"the config has no {brief(name)}{_suggestion(name, known)}; `rans list TASK` and "
            "`rans list TRAINING` tell its entries, and any run's config.json."
        )
    *parents, last = result[0].split(".")
    inner = table
    for parent in parents:
        inner = inner[parent]
    inner[last] = value


def _suggestion(name: str, known: list[str]) -> str:
    """A known entry that is meant, by its name elsewhere or by its spelling."""
    last = name.rpartition(".")[2].lower()
    if (other := _OTHERS_NAMES.get(last)) in known:
        return f" (did you mean {other}?)"
    if len(name) > 100:
        return ""

    def likeness(one: str) -> float:
        alike = difflib.SequenceMatcher(None, name, one).ratio()
        return max(
            alike, difflib.SequenceMatcher(None, last, one.rpartition(".")[2]).ratio() - 1e-3
        )

    best = max(known, key=likeness)
    return f" (did you mean {best}?)" if likeness(best) >= _NEAR else ""


def _names(table: Mapping[str, Any], above: str = "") -> Iterator[str]:
    """Every entry of a nested table, by its dotted name; tables themselves too."""
    for key, value in table.items():
        yield above + key
        if isinstance(value, Mapping):
            yield from _names(value, f"{above}{key}.")
