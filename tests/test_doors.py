"""Every door converts each kind of input, or refuses it in a sentence that names it: what one takes its twins take.

A door is a row of one of the tables below, and a wrong value is passed through every door of its kind.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.error import ResetNeeded
from rans_missions.ccsds import OrbitState, relative_state, write_ccsds

import rans
from rans import ConfigError
from rans.episode.scenario import scenarios
from tests.support.policies import Counting

COUNT = 3
PLATFORM = rans.load_spacecraft("floating-platform")
THROTTLED = str(Path(__file__).parents[1] / "examples/trainers/throttled-platform.toml")


def refused(door: Callable[[Any], object], value: object, *words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        door(value)
    for word in words:
        assert word in str(caught.value)


# Environments: actions and seeds


@cache
def team() -> Any:
    pytest.importorskip("pettingzoo")
    from rans_missions.team.parallel_env import TeamEnv

    return TeamEnv()


class Door:
    """An environment of throttled thrusters, which takes rows of actions, one for each of its craft."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.rows = 1 if name in ("single", "drake") else COUNT
        ids = {"single": "rans/GoToPose2D-v0", "drake": "rans/GoToPose2D-Drake-v0"}
        if name in ids:
            self.env: Any = gymnasium.make(ids[name], spacecraft=THROTTLED).unwrapped
        elif name == "batch":
            self.env = gymnasium.make_vec("rans/GoToPose2D-v0", COUNT, spacecraft=THROTTLED)
        elif name == "team":
            self.env = team()
        else:
            self.env = rans.Engine(THROTTLED, "go-to-pose", COUNT)
            if name == "sb3":
                self.env = rans.SB3VecEnv(self.env)
        self.width = 6 if name == "team" else 8

    def reset(self, seed: Any) -> Any:
        if self.name == "sb3":
            self.env.seed(seed)
            return self.env.reset()
        return self.env.reset(seed) if self.name == "engine" else self.env.reset(seed=seed)[0]

    def step(self, action: Any) -> Any:
        if self.name == "team":
            action = dict(zip(self.env.possible_agents, action, strict=False))
        elif self.name == "engine":
            action = torch.as_tensor(action)
        elif self.rows == 1:
            (action,) = action
        return self.env.step(action)


DOORS = ("single", "drake", "batch", "sb3", "team", "engine")


@cache
def opened(name: str) -> Door:
    return Door(name)


@pytest.fixture(params=DOORS)
def door(request) -> Door:
    return opened(request.param)


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, math.nan, "1", True, [1, 2]])
def test_seeds_of_environments(door, seed):
    refused(door.reset, seed, "seed must be a whole number")


def test_a_seed_of_numpy_is_that_number(door):
    rows = [door.reset(seed) for seed in (7, np.int64(7), 7.0)]
    rows = [np.stack([*row.values()]) if isinstance(row, dict) else row for row in rows]
    for row in rows[1:]:
        np.testing.assert_array_equal(rows[0], row)


ODD: dict[str, Callable[[torch.Tensor], Any]] = {
    "sparse_coo": lambda x: x.to_sparse(),
    "sparse_csr": lambda x: torch.atleast_2d(x).to_sparse_csr(),
    "nested": lambda x: torch.nested.nested_tensor([x]),
    "meta": lambda x: x.to("meta"),
    "mkldnn": lambda x: x.to_mkldnn(),
    "quantized": lambda x: torch.quantize_per_tensor(x, 1.0, 0, torch.quint8),
    "complex": lambda x: x.to(torch.complex64).conj(),
    "texts": lambda x: x.numpy().astype(str),
    "beyond floats": lambda x: np.full(x.shape, 10**400, object),
    "times": lambda x: x.numpy().astype("datetime64[s]"),
    "records": lambda x: np.zeros(x.shape, [("a", float)]),
    "ragged": lambda x: [[1.0], [1.0, 0.0]] * x.ndim,
    "short": lambda x: x[..., 1:],
}


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 1.001, -0.001, *ODD])
@pytest.mark.filterwarnings("ignore")  # torch says of most that they are prototypes
def test_actions(door, wrong):
    door.reset(0)
    action = torch.zeros(door.rows, door.width)
    if wrong not in ODD:
        action[0, 2] = wrong
        refused(door.step, action, "action")
    elif door.name != "engine":  # which takes tensors alone
        row = ODD[wrong](action[0] if door.rows == 1 else action)
        if door.name == "team":
            row = [ODD[wrong](deputy) for deputy in action]
        refused(door.step, [row] if door.rows == 1 else row, "ction")


SAME: dict[str, Callable[[np.ndarray], Any]] = {
    "lists": np.ndarray.tolist,
    "tuple": tuple,
    "truths": lambda x: x.astype(bool),
    "double": lambda x: x.astype(float),
    "wide": lambda x: x.astype(np.longdouble),
    "big-endian": lambda x: x.astype(">f4"),
    "mirrored": lambda x: x[:, ::-1].copy()[:, ::-1],
    "read-only": lambda x: np.broadcast_to(x[:1], x.shape),  # as JAX and memory maps give them
    "tensor": lambda x: torch.tensor(x, requires_grad=True),
    "bfloat16": lambda x: torch.tensor(x, dtype=torch.bfloat16),
    "ulp": lambda x: x * np.nextafter(np.float32(1.0), np.float32(2.0)),
}


@pytest.mark.parametrize("kind", SAME)
@pytest.mark.parametrize("name", [name for name in DOORS if name != "engine"])
def test_actions_that_mean_the_same_fly_the_same(name, kind):
    door = opened(name)
    plain = np.tile(np.array([1.0, 0.0], np.float32), (door.rows, door.width // 2))
    seen = []
    for action in (plain, SAME[kind](plain)):
        door.reset(3)
        first = door.step(action)[0]
        seen.append(
            np.stack([*first.values()]) if isinstance(first, dict) else np.asarray(first).copy()
        )
    np.testing.assert_array_equal(seen[0], seen[1])


def test_a_team_names_who_is_missing_and_ends_once():
    env = team()
    env.reset(seed=0)
    still = {agent: np.zeros(6) for agent in env.agents}
    refused(env.step, {}, "deputy_2", "got []")
    refused(env.step, still | {"chief": np.zeros(6)}, "chief")
    assert env.state().shape == (len(still) * env.observation_spaces["deputy_0"].shape[0],)
    assert env.action_spaces["deputy_1"] is env.action_space("deputy_1")
    others = [type(env)() for _ in range(2)]
    with pytest.raises(ResetNeeded):
        others[0].step(still)
    first, second = (other.reset()[0]["deputy_0"] for other in others)
    assert (first != second).any()


@pytest.mark.parametrize("name", ["rans/GoToPose2D-v0", "rans/GoToPose2D-Drake-v0"])
def test_an_episode_that_a_wrapper_ends_says_whether_it_succeeded(name):
    env = gymnasium.make(name, max_episode_steps=2)
    env.reset(seed=0)
    for _ in range(2):
        *_, truncated, info = env.step(np.zeros(8, int))
    assert truncated
    assert info["at_goal"] is False


# Functions: seeds


@cache
def agent() -> Any:
    return rans.load_agent("go-to-pose-2d")


SEEDED: dict[str, Callable[[Any], object]] = {
    "evaluate": lambda seed: agent().evaluate(episodes=2, seed=seed),
    "compare": lambda seed: rans.compare(agent(), episodes=2, certified=0, beside=(), seed=seed),
    "fly": lambda seed: agent().fly(seed=seed),
    "view": lambda seed: agent().view(seed=seed),
    "stress": lambda seed: rans.stress(agent(), episodes=2, seed=seed),
    "train": lambda seed: rans.train("go-to-pose", seed=seed),
    "scenarios": lambda seed: scenarios(rans.GoToPose(), PLATFORM, seed, 2),
    "engine": lambda seed: rans.Engine(PLATFORM, "go-to-pose", 2, seed=seed),
}


@pytest.mark.parametrize("name", SEEDED)
@pytest.mark.parametrize("seed", [-1, 2**64, 1.5])
@pytest.mark.usefixtures("here")
def test_seeds_of_functions(name, seed):
    refused(SEEDED[name], seed, "seed must be a whole number", str(seed))


# Names of folders


WRITING: dict[str, Callable[[Any], object]] = {
    "train": lambda folder: rans.train("go-to-pose", output=folder),
    "compare": lambda folder: rans.compare(agent(), episodes=1, output=folder),
    "stress": lambda folder: rans.stress(agent(), episodes=1, output=folder),
    "assure": lambda folder: agent().assure(episodes=1, output=folder),
    "export": lambda folder: agent().export(folder, "numpy"),
    "save": lambda folder: agent().save(folder),
    "ephemeris": lambda folder: write_ccsds(hold(), folder),
}


@pytest.mark.parametrize("name", WRITING)
def test_an_empty_name_is_not_the_current_folder(name, here):
    refused(WRITING[name], "", "empty")
    assert list(here.iterdir()) == []


# Policies: observations, ends of episodes and memories


@cache
def remembering(name: str) -> Any:
    if name == "own":
        return rans.load_agent("go-to-pose-2d-faults")
    return rans.load_agent(Counting(), "go-to-pose")


OBSERVATIONS = np.random.default_rng(0).normal(size=(COUNT, 10)).astype(np.float32)
STARTS: dict[str, Any] = {
    "list": [1, 0, 1],
    "truths": [True, False, True],
    "int64": np.array([1, 0, 1]),
    "uint8": np.array([1, 0, 1], np.uint8),
    "float": np.array([1.0, 0.0, 1.0]),
    "column": np.array([[1], [0], [1]]),
    "tensor": torch.tensor([1, 0, 1]),
}


@pytest.mark.parametrize("kind", STARTS)
@pytest.mark.parametrize("name", ["own", "other"])
def test_ends_of_episodes(name, kind):
    one = remembering(name)
    _, memory = one.predict(OBSERVATIONS)
    _, memory = one.predict(OBSERVATIONS, memory)
    expected = one.predict(OBSERVATIONS, memory, np.array([True, False, True]))
    taken = one.predict(OBSERVATIONS, memory, STARTS[kind])
    np.testing.assert_array_equal(expected[0], taken[0])
    np.testing.assert_array_equal(expected[1][0], taken[1][0])
    assert (expected[1][0] != one.predict(OBSERVATIONS, memory)[1][0]).any()


@pytest.mark.parametrize("wrong", [[1, 0], [2, 0, 1], [math.nan, 0, 1], "101", [[1, 0, 1]] * 3, 1])
@pytest.mark.parametrize("name", ["own", "other"])
def test_ends_of_episodes_that_are_none(name, wrong):
    one = remembering(name)
    _, memory = one.predict(OBSERVATIONS)
    refused(
        lambda starts: one.predict(OBSERVATIONS, memory, starts), wrong, "episode_start", "3 times"
    )


@pytest.mark.parametrize(
    "wrong", [np.zeros((COUNT, 9)), ["a"] * 10, [[1.0], [1.0, 2.0]], 3.0, None]
)
@pytest.mark.parametrize("name", ["own", "other", "plain"])
def test_observations(name, wrong):
    one = agent() if name == "plain" else remembering(name)
    refused(one.predict, wrong, "observ")


@pytest.mark.parametrize("wrong", [(np.zeros((COUNT, 5), np.float32),), "memory", 3, ([[0, 1]],)])
def test_memories(wrong):
    refused(
        lambda memory: remembering("own").predict(OBSERVATIONS, memory), wrong, "memory must be"
    )


# Policies that answer otherwise a second time, at each door for policies


class Sampled(torch.nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.layer = torch.nn.Linear(10, 8)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return torch.bernoulli(torch.sigmoid(self.layer(x)))


class Sampling:
    def predict(self, observation: Any, state: Any = None, **_: Any) -> Any:
        return np.random.default_rng().integers(0, 2, (len(observation), 8)), None


class Alternating:
    """A function with a state of its own."""

    count = 0

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        self.count += 1
        return np.full((len(observation), 8), self.count % 2)


def of_the_batch(observation: np.ndarray) -> np.ndarray:
    return observation[:, :8] > observation[:, :8].mean(axis=0)


def alternating(observation: np.ndarray, asked: list[int] = []) -> np.ndarray:  # noqa: B006
    """A function of a module, as ``python:`` names it."""
    asked.append(0)
    return np.full((len(observation), 8), len(asked) % 2)


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        (Sampled, "differently a second time"),
        (Sampling, "differently a second time"),
        (Alternating, "differently a second time"),
        (lambda: of_the_batch, "alone otherwise"),
        (lambda: f"python:{__name__}:alternating:go-to-pose-2d", "differently a second time"),
    ],
)
def test_policies_that_answer_otherwise(policy, words):
    given = policy()
    one = rans.load_agent(given, None if isinstance(given, str) else "go-to-pose")
    refused(one.predict, OBSERVATIONS, words)
    refused(one.fly, COUNT, words)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float16, torch.bfloat16])
def test_modules_of_every_precision(dtype):
    module = torch.nn.Sequential(torch.nn.Linear(10, 8).to(dtype), torch.nn.Hardtanh(0.0, 1.0))
    one = rans.load_agent(module, "go-to-pose", THROTTLED)
    exact = np.asarray(module.double()(torch.as_tensor(OBSERVATIONS).double()).detach())
    assert one.predict(OBSERVATIONS)[0] == pytest.approx(exact, abs=0.05)  # bfloat16 has 8 bits


@pytest.mark.parametrize("answer", [{}, torch.distributions.Bernoulli(torch.ones(3, 8)), 3.0])
def test_what_is_no_array_of_commands(answer):
    refused(rans.load_agent(lambda _: answer, "go-to-pose").predict, OBSERVATIONS, "commands")


# Times, angles, epochs


@cache
def hold() -> Any:
    starts = scenarios(rans.Hold(), rans.load_spacecraft("vbar-chaser"), 7, 1)
    timing = rans.Timing(control_period=10.0, episode_steps=5)
    controller = rans.MissionGuidance("vbar-chaser", "hold")
    return rans.fly("vbar-chaser", "hold", controller, starts, timing)


WRONG: dict[str, list[Any]] = {
    "inclination": [math.nan, math.inf, "51.6", None],
    "node": [math.nan, -math.inf],
    "latitude": [math.nan, True],
    "episode": [-1, 1, 0.5, "0"],
    "epoch": [
        "tomorrow",
        math.nan,
        None,
        "2016-12-31T23:59:60",
        "2016-12-31T23:59:10",
        datetime(2015, 6, 30, 23, 59, 30),
        "9999-12-31T23:59:59",
    ],
}


@pytest.mark.parametrize(("name", "wrong"), [(name, x) for name in WRONG for x in WRONG[name]])
def test_arguments_of_an_ephemeris(name, wrong, here):
    with pytest.raises(ConfigError, match=f"{name}|leap second|has episodes"):
        write_ccsds(hold(), here, **{name: wrong})
    assert list(here.iterdir()) == []


def test_an_epoch_is_an_instant_in_any_form(here):
    noon = datetime(2026, 3, 1, 12)
    epochs = [
        "2026-03-01T12:00",
        noon,
        noon.replace(tzinfo=UTC),
        noon.replace(tzinfo=UTC).astimezone(),
    ]
    texts = {
        write_ccsds(hold(), here, epoch=epoch, inclination=np.float32(51.5))[0]  # pyrefly: ignore
        .read_text()
        .partition("META_START")[2]
        for epoch in epochs
    }
    assert len(texts) == 1


def test_a_target_is_near():
    """At a hundredth of the radius linear equations err as on the most eccentric orbit that is taken."""
    target, epoch = np.array([7e6, 0.0, 0.0]), datetime(2026, 1, 1)
    states = [
        OrbitState(
            "", "EME2000", epoch, target + np.array([0.0, off, 0.0]), np.array([0.0, 7546.053, 0.0])
        )
        for off in (0.0, 6.9e4, 7.1e4)
    ]
    assert relative_state(states[0], states[1])[1][1] == pytest.approx(6.9e4)
    refused(lambda craft: relative_state(states[0], craft), states[2], "within 70 km", "71 km")


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 0.0, -0.2, "0.2", True, None])
def test_periods(wrong):
    refused(lambda period: rans.Timing(control_period=period), wrong, "control_period must be")


@pytest.mark.parametrize("name", ["substeps", "episode_steps", "checks"])
def test_counts_of_a_timing(name):
    for wrong in (0, 1.5, math.nan, "2", True):
        refused(lambda count: rans.Timing(**{name: count}), wrong, f"{name} must be a whole number")
    taken = rans.Timing(np.float32(0.25), **{name: np.int64(2)})  # type: ignore[arg-type]
    assert taken == rans.Timing(0.25, **{name: 2})  # type: ignore[arg-type]
    assert {type(taken.control_period), type(getattr(taken, name))} == {float, int}
