"""The page in which an agent flies in the browser: what its JavaScript computes, against the code in Python."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.tasks import Dock, TargetOrbit

import rans
from examples.single_file.controller import PD
from rans import Conditions, ConfigError, Engine, ThrusterConditions
from rans.api.pages import flyers
from rans.base.registry import typed
from rans.compile.javascript import activations
from rans.deploy.contract import flights_of_training, golden
from rans.episode.scenario import scenarios
from rans.episode.step import Setup
from rans.evaluation.fly.agent import Agent, LoadedRun
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.fast.learn.config import MemorySettings
from rans.model.fields import leaves, wrap
from rans.model.random import seed_words
from rans.model.spacecraft_file import load_spacecraft
from rans.policy.activations import ACTIVATIONS
from rans.show.pages.playground import _Traced, interactive_world, playground
from tests.support.browser import opened, served
from tests.support.interactive_flight import InteractiveFlight
from tests.support.processes import PATIENCE
from tests.support.training import learner_on

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="needs Node.js to run JavaScript")
AGENTS = (
    pytest.param("go-to-pose-2d", marks=pytest.mark.slow),
    "go-to-pose-2d-robust",
    "any-craft-3d@astrobee-iss",
    "any-craft-2d",
    "any-craft-2d#1",
    pytest.param("any-craft-2d@pingu", marks=pytest.mark.slow),
)
"""Without a memory, with filters and a history of commands, with allocation to throttled thrusters in space, to
on/off thrusters, at a price that falls near the goal too, and to throttled ones and a wheel."""
SEED = 7


OF_ONE_CRAFT = "of one craft"
"""An agent of a craft with a shared supply, which opens them together by a memory; untrained."""


def run_of(name: str) -> LoadedRun:
    if name == OF_ONE_CRAFT:
        run = run_of("any-craft-2d@floating-platform-shared")
        engine = Engine(run.craft, run.task, 4, run.timing)
        learner = learner_on(
            engine, backbone="allocated", symmetric=False, memory=MemorySettings(2)
        )
        return run._replace(controller=Agent(learner.network, name, run.craft))
    (run,) = flyers((name if "@" in name else f"pretrained:{name}",), None, False)
    return run


def answer(script: str, tmp_path: Path) -> Any:
    """What a script prints, read as JSON."""
    assert NODE is not None
    file = tmp_path / "script.js"
    file.write_text(script)
    done = subprocess.run(
        [NODE, str(file)], capture_output=True, text=True, check=False, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@needs_node
def test_activations_are_those_of_torch(tmp_path):
    points = [-3.0, -0.5, 0.0, 0.25, 2.0]
    names = list(ACTIVATIONS)
    found = answer(
        f"{activations()} console.log(JSON.stringify({names}.map(n => {points}.map(ACTIVATIONS[n]))))",
        tmp_path,
    )
    for name, row in zip(names, found, strict=True):
        module = getattr(torch.nn, ACTIVATIONS[name].module)()
        expected = module(torch.tensor(points, dtype=torch.float64)).tolist()
        assert row == pytest.approx(expected, abs=1e-12), name


@needs_node
@pytest.mark.parametrize(
    "name", [*AGENTS, pytest.param("any-craft-3d@cubesat-3u", marks=pytest.mark.slow)]
)
def test_it_starts_moves_and_observes_as_python_does(name, tmp_path):
    """The same start, and then its own commands, late and with thrusters that fail.

    The CubeSat has pulsed thrusters and three reaction wheels, which change its motion between substeps.
    """
    run = run_of(name)
    page = playground(run, SEED)
    script = f"""{page.script}
const flight = new Flight(5), taken = [];
flight.delay = 1;
for (let k = 0; k < 40; ++k) {{
  if (k === 10) {{ flight.faults[0] = "dead"; flight.faults[3] = "stuck open"; }}
  if (k === 20 && DATA.moves) flight.placeGoal([1, -0.5, 0.3]);
  flight.step();
  taken.push({{command: flight.command, state: flight.carried.slice(0, DATA.goal), errors: flight.seen.errors}});
}}
console.log(JSON.stringify(taken));"""
    found = answer(script, tmp_path)

    commands = iter([*(row["command"] for row in found[1:]), found[-1]["command"]])
    flight = InteractiveFlight(run, SEED, 5, commands)
    flight.delay = 1
    for k, row in enumerate(found):
        if k == 10:
            flight.dead.add(0)
            flight.stuck.add(3)
        if k == 20 and flight.moves:
            flight.place_goal([1.0, -0.5, 0.3])
        flight.step()
        np.testing.assert_allclose(
            row["state"], np.ravel(leaves(flight.state)[: len(row["state"])]), rtol=0, atol=1e-9
        )
        assert row["errors"] == pytest.approx([*flight.errors().values()], abs=1e-9)


@needs_node
@pytest.mark.parametrize(
    "name",
    [
        *AGENTS,
        OF_ONE_CRAFT,
        pytest.param(
            "adaptive:any-craft-2d@floating-platform-shared",
            marks=[pytest.mark.slow],
        ),
    ],
)
def test_its_commands_are_those_of_the_agent(name, tmp_path):
    """On flights, memory and all; no choice is close there, so that weights of 16 bits change none.

    A throttle's duty is off by less than a thousandth.
    """
    run = run_of(name)
    controller = run.controller
    assert isinstance(controller, Agent)
    setup = Setup(run.craft, run.task, replace(run.timing, episode_steps=20))
    flights = flights_of_training(controller, setup, count=24)
    pairs = golden(controller.network, flights, run.craft)
    page = playground(run, SEED)
    states = [flat(state) for state in pairs["state"]]
    goals = [flat(goal) for goal in pairs["goal"]]
    script = f"""{page.script}
const states = {states}, goals = {goals}, begins = {json.dumps(pairs["begins"])};
let memory = [];
const found = states.map((state, k) => {{
  if (begins[k]) memory = new Array(DATA.memory).fill(0);
  const first = begin([...DATA.words, 0]).carried;
  const given = [...state, ...goals[k]];
  const carried = first.map((x, i) => given[i] ?? x);
  const answer = act(carried, DATA.noise.map(() => 0), memory);
  memory = answer.memory;
  return answer.command;
}});
console.log(JSON.stringify(found));"""
    found = np.array(answer(script, tmp_path))
    expected = np.array(pairs["command"])
    tolerance = 1e-3 if controller.network.architecture.continuous else 0.0
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


def flat(quantities: dict[str, Any]) -> list[float]:
    """Position, heading or quaternion, velocity, angular velocity and stores of a state in a contract."""
    attitude = quantities["attitude"]
    if len(quantities["position"]) == 2:
        attitude = wrap(attitude if isinstance(attitude, float) else math.atan2(*attitude[::-1]))
    rows = (quantities["position"], attitude, quantities["velocity"], quantities["spin"])
    return np.concatenate([*map(np.ravel, rows), quantities.get("stores", [])]).tolist()


@needs_node
def test_it_begins_with_the_delay_of_the_training(tmp_path):
    """Trained at 40 to 80 ms of 200 ms: of each period 0.3 has the command before. By hand from all commands."""
    trained = Conditions(thrusters=ThrusterConditions(latency=(0.04, 0.08)))
    run = run_of("go-to-pose-2d")
    assert playground(run, SEED).data["delay"] == 0.0
    page = playground(run._replace(conditions=trained), SEED)
    assert page.data["delay"] == pytest.approx(0.3)
    script = f"""{page.script}
const flight = new Flight(5), flown = [];
for (let k = 0; k < 8; ++k) {{ flight.step(); flown.push([flight.waiting.at(-1), flight.command]); }}
console.log(JSON.stringify(flown));"""
    before = np.zeros(len(run.craft.commands))
    opened = 0.0
    for asked, given in answer(script, tmp_path):
        np.testing.assert_allclose(given, 0.7 * np.array(asked) + 0.3 * before, rtol=0, atol=1e-12)
        before = np.array(asked)
        opened += before.sum()
    assert opened > 0


@needs_node
def test_rewinding_gives_the_same_flight_again(tmp_path):
    """Also of an agent with a memory, and of commands that are under way."""
    page = playground(run_of("go-to-pose-2d-robust"), SEED)
    script = f"""{page.script}
const flight = new Flight(2); flight.delay = 2;
for (let k = 0; k < 30; ++k) flight.step();
const once = flight.carried;
flight.rewind(12);
const between = flight.time;
for (let k = 0; k < 12; ++k) flight.step();
console.log(JSON.stringify([between, once, flight.carried]));"""
    between, once, again = answer(script, tmp_path)
    assert between == pytest.approx(18 * page.data["period"])
    assert once == again


@pytest.mark.parametrize(
    "name",
    [
        "go-to-pose-2d",
        "go-to-pose-3d",
        pytest.param("any-craft-3d@cubesat-3u", marks=pytest.mark.slow),
        "any-craft-2d",
    ],
)
def test_the_page_is_small_and_fetches_nothing(name, tmp_path):
    """Many weights, more than have 16 bits in so little, and many substeps in space."""
    page = playground(run_of(name), SEED)
    page.write(tmp_path / "fly.html")
    text = (tmp_path / "fly.html").read_text()
    assert len(text.encode()) <= 300_000
    assert not re.search(r"(?:src|href)=|https?:|@import|fetch\(|XMLHttpRequest", text)


class Branching(PD):
    """A page knows no numbers to branch on."""

    def command(self, state: Any, goal: Any) -> tuple[Any, ...]:
        return (1.0,) * 8 if state.p.x > 0.0 else (0.0,) * 8


class Refusing(PD):
    """Has a sentence of its own."""

    def command(self, state: Any, goal: Any) -> tuple[Any, ...]:
        raise ConfigError("it is dark.")


@pytest.mark.parametrize(
    ("who", "why"),
    [
        ("lqr:go-to-pose-2d", "no trained agent"),
        (f"{__name__}:Branching:go-to-pose-2d", "`command` of .*Branching.* must be arithmetic"),
        (f"{__name__}:Refusing:go-to-pose-2d", "Refusing.* it is dark"),
    ],
)
def test_others_are_refused_in_a_sentence(who, why):
    with pytest.raises(ConfigError, match=why):
        playground(contestant(typed(who)), SEED)


@needs_node
def test_a_controller_of_ones_own_flies_in_a_page_as_in_python(tmp_path):
    """That of the example that readers copy, by the name that a user types."""
    run = contestant(typed("examples.single_file.controller:PD:go-to-pose-2d"))
    script = f"""{playground(run, SEED).script}
const flight = new Flight(5), taken = [];
for (let k = 0; k < 40; ++k) {{
  flight.step();
  taken.push({{command: flight.command, state: flight.carried.slice(0, DATA.goal)}});
}}
console.log(JSON.stringify(taken));"""
    flight = InteractiveFlight(run, SEED, 5)
    for row in answer(script, tmp_path):
        flight.step()
        np.testing.assert_array_equal(row["command"], flight.command)
        # Rounding of 40 steps.
        np.testing.assert_allclose(row["state"], np.ravel(leaves(flight.state)), rtol=0, atol=1e-9)


@needs_node
@pytest.mark.slow
@pytest.mark.parametrize("orbit", ["circle", "ellipse"])
def test_guidance_flies_in_a_page_as_in_python(orbit, tmp_path):
    """The page wins its mission; the first periods are those of Python, within a millimetre.

    On an ellipse each flight has its own anomaly, which moves on in the page too. Burns of 10 to 50 s follow from
    differences of large numbers, which double precision has to 1e-9 or so.
    """
    count = 2
    run = contestant("mission:rendezvous-3d")
    if orbit == "ellipse":
        run = contestant("mission:dock-3d")
        task = Dock(orbit=TargetOrbit(eccentricity=0.5, semi_major_axis_km=13_556.0))
        run = run._replace(task=task, controller=MissionGuidance(run.craft, task))
    page = playground(run, SEED)
    script = f"""{page.script}
const found = Array.from({{length: {count}}}, (_, number) => {{
  const flight = new Flight(number), path = [flight.pose().slice(0, 3)];
  while (!flight.over && path.length < {run.timing.episode_steps}) {{
    flight.step();
    path.push(flight.pose().slice(0, 3));
  }}
  return {{path, over: flight.over}};
}});
console.log(JSON.stringify(found));"""
    found = answer(script, tmp_path)

    assert [row["over"] for row in found] == ["won"] * count
    run = run._replace(timing=replace(run.timing, episode_steps=25))
    flight = fly_episodes(run.controller, run.judged, SEED, 1, workers=1)
    positions = np.stack(flight.states.p.columns(), axis=-1)[:, 0]
    path = np.array(found[0]["path"])[: len(positions)]
    np.testing.assert_allclose(path, positions[: len(path)], rtol=0, atol=1e-3)


@needs_node
def test_points_of_an_inspection_are_marked_once_they_are_seen(tmp_path):
    """After a period with shut thrusters: those above whose horizon both craft and sun are, or were before."""
    task = rans.load_task("inspect")
    craft = load_spacecraft("afrl-deputy")
    traced = _Traced(interactive_world(Setup(craft, task, task.timing), 10.0))
    script = f"""{traced.begin()}
{traced.describe()}
{traced.advance()}
let carried = begin([...{json.dumps(seed_words(SEED))}, 0]).carried;
const found = [];
for (let k = 0; k < 3; ++k) {{
  carried = advance(carried, Array(6).fill(0), Array(6).fill(1), Array(6).fill(0)).carried;
  found.push({{position: carried.slice(0, 3), markers: describe(carried).markers}});
}}
console.log(JSON.stringify(found));"""
    rows = answer(script, tmp_path)
    sun = float(np.ravel(scenarios(task, craft, SEED, 1).goal.notes.sun)[0])
    seen = np.zeros(100, dtype=bool)
    for k, row in enumerate(rows, 1):
        markers = np.array(row["markers"], dtype=float).reshape(-1, 4)
        points = markers[:, :3]
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), 10.0)
        angle = sun - 20.0 * k * 0.001027
        lit = points @ np.array([math.cos(angle), math.sin(angle), 0.0]) > 0.0
        seen |= lit & ((np.array(row["position"]) - points) @ points.T > 0.0).diagonal()
        # The check in the middle of a period sees a point or two more or less on the terminator.
        assert np.count_nonzero(seen != markers[:, 3].astype(bool)) <= 2
    assert 20 < seen.sum() < 80


_ALARM = (
    '<script>addEventListener("error", '
    "event => { document.body.dataset.error = event.message; });</script>"
)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["any-craft-2d", "mission:dock-3d"])
def test_a_browser_runs_the_page_whole_and_near(name, tmp_path):
    """Every script of it without an error, from far and from near; a page with an error says so."""
    (run,) = flyers((name,), None, False)
    page = playground(run).html().replace("<h1>", f"{_ALARM}<h1>", 1)
    assert _ALARM in page
    press = '<script>at("closer").click();</script>'
    pages = {
        "/": page.replace("</body>", f"{press}</body>"),
        "/wrong": page.replace("</body>", "<script>nothing();</script></body>"),
    }
    with served(pages) as (address, _):
        near = opened(f"{address}/", tmp_path / "near")
        wrong = opened(f"{address}/wrong", tmp_path / "wrong")
    assert "data-error" not in near.partition("<script")[0]
    assert 'id="closer">Whole way<' in near
    assert re.search(r"<body[^>]* data-error=", wrong)


def test_no_page_of_the_site_has_a_frame_with_a_fragment():
    """It scrolls the page around it."""
    docs = Path(__file__).parents[3] / "docs"
    frames = [
        found
        for file in (*docs.rglob("*.md"), *docs.rglob("*.py"))
        for found in re.findall(r"<iframe[^>]*>", file.read_text("utf-8"))
    ]
    assert frames
    assert [frame for frame in frames if "#" in frame] == []
