"""Changes of a training config by the names of its entries, for options and keyword arguments."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from rans.errors import ConfigError, brief
from rans.fast.learn.learners import complete
from rans.registry import typed

OTHERS_NAMES = {
    "lr": "ppo.learning_rate",
    "alpha": "ppo.learning_rate",
    "batch": "ppo.batch_size",
    "envs": "ppo.n_envs",
    "environments": "ppo.n_envs",
    "rollout_steps": "ppo.n_steps",
    "horizon": "ppo.n_steps",
    "update_epochs": "ppo.n_epochs",
    "discount": "ppo.gamma",
    "gae": "ppo.gae_lambda",
    "lmbda": "ppo.gae_lambda",
    "hidden": "ppo.layers",
    "network": "ppo.layers",
    "steps": "total_timesteps",
    "num_timesteps": "total_timesteps",
    "n_timesteps": "total_timesteps",
    "num_envs": "ppo.n_envs",
    "num_steps": "ppo.n_steps",
    "horizon_length": "ppo.n_steps",
    "minibatch_size": "ppo.batch_size",
    "mini_epochs": "ppo.n_epochs",
    "num_epochs": "ppo.n_epochs",
    "epochs": "ppo.n_epochs",
    "lam": "ppo.gae_lambda",
    "net_arch": "ppo.layers",
    "hidden_sizes": "ppo.layers",
    "total_steps": "total_timesteps",
    "timesteps": "total_timesteps",
    "max_episode_steps": "timing.episode_steps",
    "dt": "timing.control_period",
}
"""Names of entries in SB3, CleanRL, rl_games, rsl_rl and Gymnasium, for suggestions."""
_NEAR = 0.7
"""Similarity from which a name is suggested."""


def change_entry(table: dict[str, Any], name: str, value: Any) -> None:
    """Change one entry of a config table.

    Args:
        table: config from `rans.fast.learn.config.to_table`, changed in place.
        name: see `entry_named`.
        value: new value, which the user has given: names in it may be MODULE:NAME (`rans.registry.typed`).

    Raises:
        ConfigError: see `entry_named`.
    """
    entry = entry_named(table, name)
    *parents, last = entry.split(".")
    inner = table
    for parent in parents:
        inner = inner[parent]
    inner[last] = _typed(value)
    if entry == "algorithm":  # whose own settings are others
        table["learner"] = complete(table["algorithm"], {})


def entry_named(table: Mapping[str, Any], name: str) -> str:
    """Full dotted name of the entry of a config table that a name means.

    Args:
        table: config from `rans.fast.learn.config.to_table`.
        name: full name of the entry, as ``ppo.learning_rate``, or its last part if that is unique.

    Raises:
        ConfigError: there is no such entry, or the name is not unique.
    """
    names = list(_names(table))
    result = (
        [name]
        if name in names
        else [candidate for candidate in names if candidate.endswith(f".{name}")]
    )
    # An entry of the task itself comes before one of a value in it.
    depth = min((key.count(".") for key in result), default=0)
    result = [key for key in result if key.count(".") == depth]
    if len(result) > 1:
        raise ConfigError(
            f"several entries of the config are called {brief(name)}: choose one of {', '.join(result)}."
        )
    if not result:
        raise ConfigError(
            f"the config has no {brief(name)}{_suggestion(name, names)}; `rans list TASK`, "
            "`rans list TRAINING` and the config.json of any run show its entries."
        )
    return result[0]


def check_memory(table: Mapping[str, Any], changes: Iterable[str]) -> None:
    """Refuse changes of a memory that the network does not have: they would change nothing.

    Args:
        table: config with the changes.
        changes: names of the entries that were changed, full or their last parts.

    Raises:
        ConfigError: a history's length was changed, and the memory has none.
    """
    memory = table["ppo"]["memory"]
    kind = memory["kind"] if isinstance(memory, Mapping) else memory
    names = {"ppo.memory.history", "memory.history", "history"}
    if kind not in ("history", "commands") and not names.isdisjoint(changes):
        raise ConfigError(
            f"ppo.memory.history is of 'history' or 'commands' memories, and this one is {kind!r}: set "
            "ppo.memory.kind=history too."
        )


def _typed(value: Any) -> Any:
    """The value, all of whose texts count as typed by the user."""
    if isinstance(value, Mapping):
        return {key: _typed(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(map(_typed, value))
    return typed(value)


def _suggestion(name: str, entries: list[str]) -> str:
    """Suggestion of a similar entry, by its name in other libraries or by its spelling; else an empty text.

    Only words of the message depend on it.
    """
    last = name.rpartition(".")[2].lower()
    if (synonym := OTHERS_NAMES.get(last)) in entries:
        return f" (did you mean {synonym}?)"
    if len(name) > 100:
        return ""

    def likeness(entry: str) -> float:
        alike = difflib.SequenceMatcher(None, name, entry).ratio()
        return max(
            alike, difflib.SequenceMatcher(None, last, entry.rpartition(".")[2]).ratio() - 1e-3
        )

    best = max(entries, key=likeness)
    return f" (did you mean {best}?)" if likeness(best) >= _NEAR else ""


def _names(table: Mapping[str, Any], above: str = "") -> Iterator[str]:
    """Yield the dotted names of all entries of a nested table, including tables."""
    for key, value in table.items():
        yield above + key
        if isinstance(value, Mapping):
            yield from _names(value, f"{above}{key}.")
