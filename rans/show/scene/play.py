"""A window in which a person plays with a flight: sliders, buttons and a gamepad in Drake's Meshcat."""

# Drake's stubs write NumPy's array types with their two parameters exchanged.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from itertools import cycle, islice
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams, Rgba, Sphere
from pydrake.math import RigidTransform

from rans.drawing import columns
from rans.evaluation.fly.agent import LoadedRun
from rans.model.fields import map_leaves
from rans.outline import Outline
from rans.show.scene import craft, scene
from rans.show.scene.camera import fitted_camera
from rans.show.scene.interactive import InteractiveFlight
from rans.show.scene.view import ASPECT, CAMERA, DIRECTION, SKY, STAGE, UPRIGHT
from rans.tasks.quantities import QUANTITIES
from rans.tasks.shapes import Shape

REWIND = 5.0
"""s by which the button goes back."""
_REACH = 5.0
"""Farthest place that sliders move the goal to, along each axis, m."""
_TRAIL_SECONDS = 30.0
"""Length of the trail that is drawn, s."""
_PAD_SPEED = 1.0
"""Speed of the goal with a gamepad's stick at its end, m/s."""
_PAD_REST = 0.15
"""Deflection below which a stick is at rest."""
_IDLE = 0.05
"""Time between two looks at the controls while the flight stands, s."""
_DEAD = Rgba(0.75, 0.05, 0.05)
_STUCK = Rgba(1.0, 0.75, 0.0)
_LINE = Rgba(0.10, 0.52, 0.85)

PAUSE = "pause / go (space)"
STEP = "step"
BACK = f"back {REWIND:g} s"
AGAIN = "restart"
NEXT = "next start"
KILL = "kill thruster"
STICK = "stick thruster open"
REPAIR = "repair all"
SWITCH = "next controller"
_BUTTONS = (PAUSE, STEP, BACK, AGAIN, NEXT, KILL, STICK, REPAIR, SWITCH)
_AXES = ("goal x (m)", "goal y (m)", "goal z (m)")
_HEADING = "goal heading (deg)"
_THRUSTER = "thruster"
_DELAY = "delay (periods)"
_NOISE = "noise (% of 5 cm, 5 deg)"
_SPEED = "speed"


class LivePlayground:
    """One flight in Meshcat, with controls beside it.

    Sliders move the goal, choose a thruster, and set delay, noise and speed; buttons pause, step, go back, begin
    anew, take the next start, kill or stick the thruster, repair all, and let the next contestant command. A
    gamepad's left stick moves the goal. The flight's own state is `flight`.

    Raises:
        ConfigError: see `InteractiveFlight`.
    """

    def __init__(
        self,
        runs: Sequence[LoadedRun],
        seed: int,
        episode: int = 0,
        report: Callable[[str], None] = lambda _: None,
    ) -> None:
        logging.getLogger("drake").setLevel(logging.WARNING)  # it would announce a page of its own
        self.flight = InteractiveFlight(runs, seed, episode)
        self.running = True
        self._report = report
        self._meshcat = Meshcat(MeshcatParams(host="localhost", port=None))
        self._colours = list(islice(cycle(scene.BODIES), len(runs)))
        self._clicks: dict[str, int] = {}
        self._values: dict[str, float] = {}
        self._stage()
        self._add_controls()
        self._begin()

    @property
    def url(self) -> str:
        """Address of the window, for browsers of this computer."""
        return self._meshcat.web_url()

    @property
    def meshcat(self) -> Meshcat:
        """The window itself, whose sliders a program may set too."""
        return self._meshcat

    def html(self) -> str:
        """The window as it is now, as a page of its own, without its controls."""
        return self._meshcat.StaticHtml()

    def run(self) -> None:
        """Fly in real time until Ctrl-C."""
        while True:
            self.advance(sleep=time.sleep)

    def advance(self, sleep: Callable[[float], object]) -> None:
        """Read the controls and, unless it stands, fly one control period; ``sleep`` waits between frames."""
        once = self.read_controls()
        if not (self.running or once) or self.flight.over:
            self._draw(self.flight.state)
            sleep(_IDLE)
            return
        period = self.flight.world.timing.control_period
        frames = self.flight.step()
        self._trail.append(columns(self.flight.state.p)[0])
        speed = max(self._meshcat.GetSliderValue(_SPEED), 0.1)
        for frame in frames:
            self._draw(frame)
            sleep(period / len(frames) / speed)
        self._say()

    def read_controls(self) -> bool:
        """Do what sliders, buttons and the gamepad ask for; whether a single step is asked for."""
        flight = self.flight
        # Sliders: goal, delay, noise, and the thruster that buttons act on.
        self._move_goal()
        flight.delay = round(self._meshcat.GetSliderValue(_DELAY))
        flight.noise = 0.01 * self._meshcat.GetSliderValue(_NOISE)
        chosen = round(self._meshcat.GetSliderValue(_THRUSTER))
        # Buttons, in the order in which they were clicked.
        clicked = self._clicked()
        for name in clicked:
            self._press(name, chosen)
            self._mark_faults()
            self._say()
        return STEP in clicked

    def _press(self, name: str, thruster: int) -> None:
        """Do what a button asks for; two of them act on a thruster."""
        flight = self.flight
        # Time.
        if name == PAUSE:
            self.running = not self.running
        elif name == STEP:
            self.running = False
        elif name == BACK:
            flight.rewind(round(REWIND / flight.world.timing.control_period))
            self._trail.clear()
        elif name in (AGAIN, NEXT):
            flight.restart(flight.number + 1 if name == NEXT else None)
            self._begin()
        # Faults.
        elif name == KILL:
            flight.stuck.discard(thruster)
            flight.dead.add(thruster)
        elif name == STICK:
            flight.dead.discard(thruster)
            flight.stuck.add(thruster)
        elif name == REPAIR:
            flight.dead.clear()
            flight.stuck.clear()
        # Who commands.
        elif name == SWITCH:
            flight.command_by(flight.active + 1)
            self._put_craft()

    def _stage(self) -> None:
        for path, name, value in STAGE:
            self._meshcat.SetProperty(path, name, value)
        planar = self.flight.world.craft.dimension == 2
        for end, colour in zip(("top", "bottom"), SKY[not planar], strict=True):
            self._meshcat.SetProperty("/Background", f"{end}_color", colour)

    def _add_controls(self) -> None:
        craft_ = self.flight.world.craft
        for name in _BUTTONS:
            if name == SWITCH and len(self.flight.controllers) == 1:
                continue
            self._meshcat.AddButton(name, "Space" if name == PAUSE else "")
            self._clicks[name] = 0
        if self.flight.moves:
            for name in _AXES[: craft_.dimension]:
                self._slider(name=name, low=-_REACH, high=_REACH, step=0.05, value=0.0)
            if craft_.dimension == 2:
                self._slider(name=_HEADING, low=-180.0, high=180.0, step=5.0, value=0.0)
        self._slider(
            name=_THRUSTER, low=0.0, high=max(craft_.thruster_count - 1.0, 1.0), step=1.0, value=0.0
        )
        self._slider(name=_DELAY, low=0.0, high=5.0, step=1.0, value=0.0)
        self._slider(name=_NOISE, low=0.0, high=100.0, step=5.0, value=0.0)
        self._slider(name=_SPEED, low=0.25, high=4.0, step=0.25, value=1.0)

    def _slider(self, name: str, low: float, high: float, step: float, value: float) -> None:
        self._meshcat.AddSlider(name, low, high, step, value)
        self._values[name] = value

    def _clicked(self) -> list[str]:
        """Buttons pressed since the last time."""
        results = []
        for name, before in self._clicks.items():
            now = self._meshcat.GetButtonClicks(name)
            if now > before:
                results.append(name)
            self._clicks[name] = now
        return results

    def _move_goal(self) -> None:
        """Move the goal to the values of the sliders, or by a gamepad's stick."""
        flight = self.flight
        if not flight.moves:
            return
        planar = flight.world.craft.dimension == 2
        names = [*_AXES[: flight.world.craft.dimension], *([_HEADING] if planar else [])]
        axes = self._meshcat.GetGamepad().axes
        for name, push in zip(names, (axes[0], -axes[1]) if len(axes) > 1 else (), strict=False):
            if abs(push) > _PAD_REST:
                value = self._meshcat.GetSliderValue(name) + push * _PAD_SPEED * _IDLE
                self._meshcat.SetSliderValue(name, value)
        now = {name: self._meshcat.GetSliderValue(name) for name in names}
        if all(now[name] == self._values[name] for name in names):
            return
        self._values.update(now)
        heading = math.radians(now[_HEADING]) if planar else None
        flight.place_goal([now[name] for name in names if name != _HEADING], heading)

    def _begin(self) -> None:
        """Draw everything of an episode anew."""
        flight = self.flight
        spacecraft = flight.world.craft
        start = columns(flight.state.p)[0]
        goal = columns(flight.goal.p)[0] if flight.moves else start
        if flight.moves:
            self._show_goal(goal)
        length = math.ceil(_TRAIL_SECONDS / flight.world.timing.control_period)
        self._trail: deque[np.ndarray] = deque([start], maxlen=length)
        points = np.array([start, goal, -goal, start * (1.0, -1.0, 1.0)])
        low = points.min(axis=0) - 3.0 * spacecraft.radius - 0.5
        high = points.max(axis=0) + 3.0 * spacecraft.radius + 0.5
        planar = spacecraft.dimension == 2
        if planar:
            low[2] = craft.FLOOR * spacecraft.radius
            high[2] = spacecraft.radius
        self._meshcat.Delete("/play")
        self._put("/play/ground", scene.ground_parts(low, high, not planar))
        size = float(np.linalg.norm(high - low))
        self._meshcat.SetProperty(CAMERA, "near", 2e-3 * size)
        self._meshcat.SetProperty(CAMERA, "far", 3.0 * scene.STARS * size)
        camera, target = fitted_camera(np.array([low, high]), DIRECTION[planar], UPRIGHT, ASPECT)
        self._meshcat.SetCameraPose(camera, target)
        self._put_craft()
        self._put(
            "/play/goal", scene.goal_parts(spacecraft, frozenset(flight.world.task.tolerances()))
        )
        for number, shape in enumerate(self._scenery()):
            reach = float(np.linalg.norm(start - goal))
            self._put(f"/play/scenery {number}", scene.scenery_parts(shape, reach))
        self._mark_faults()
        self._draw(flight.state)

    def _scenery(self) -> list[Shape]:
        """Zones, cones and limits of the task now, of numbers."""
        flight = self.flight
        return [
            map_leaves(lambda x: float(np.asarray(x, dtype=float).ravel()[0]), shape)
            for shape in flight.world.task.scenery(flight.goal)
        ]

    def _show_goal(self, goal: np.ndarray) -> None:
        """Put the sliders where the episode's goal is."""
        values = list(zip(_AXES[: self.flight.world.craft.dimension], goal, strict=False))
        if self.flight.world.craft.dimension == 2:
            angle = float(np.asarray(self.flight.goal.attitude.angle).ravel()[0])
            values.append((_HEADING, math.degrees(math.remainder(angle, 2.0 * math.pi))))
        for name, value in values:
            self._meshcat.SetSliderValue(name, float(value))
            self._values[name] = self._meshcat.GetSliderValue(name)  # rounded to its steps

    def _put(self, path: str, parts: Sequence[craft.Part]) -> None:
        for part in parts:
            self._meshcat.SetObject(f"{path}/{part.name}", part.shape, part.colour)
            self._meshcat.SetTransform(f"{path}/{part.name}", part.pose)

    def _put_craft(self) -> None:
        """The craft in the colour of who commands it."""
        spacecraft = self.flight.world.craft
        colour = scene.BODIES[self._colours[self.flight.active]]
        self._put("/play/craft", craft.craft_parts(spacecraft, colour))
        for index, frame in enumerate(craft.plumes(spacecraft)):
            self._put(f"/play/craft/plume {index}", craft.plume_parts(spacecraft))
            self._meshcat.SetTransform(f"/play/craft/plume {index}", frame)

    def _mark_faults(self) -> None:
        """Red balls at dead thrusters, yellow ones at those stuck open."""
        outline = Outline(self.flight.world.craft)
        self._meshcat.Delete("/play/craft/faults")
        for failed, colour in ((self.flight.dead, _DEAD), (self.flight.stuck, _STUCK)):
            for number in failed:
                path = f"/play/craft/faults/{number}"
                self._meshcat.SetObject(path, Sphere(0.18 * outline.radius), colour)
                self._meshcat.SetTransform(path, RigidTransform(outline.nozzles[number].root))

    def _draw(self, state: Any) -> None:
        """Craft, goal, plumes, scenery and trail at a state, fields (1,)."""
        flight = self.flight
        (pose,) = scene.poses(state)
        (goal,) = scene.poses(flight.goal)
        if "position" not in flight.world.task.tolerances():
            goal = RigidTransform(goal.rotation(), pose.translation())
        self._meshcat.SetTransform("/play/craft", pose)
        self._meshcat.SetTransform("/play/goal", goal)
        for index in range(flight.world.craft.thruster_count):
            opening = 1.0 if index in flight.stuck else float(flight.command[index])
            lit = opening > 0.0 and index not in flight.dead
            path = f"/play/craft/plume {index}"
            self._meshcat.SetProperty(path, "visible", lit)
            self._meshcat.SetProperty(path, "scale", [1.0, 1.0, max(opening, 1e-3)])
        for number, shape in enumerate(self._scenery()):
            self._meshcat.SetTransform(f"/play/scenery {number}", scene.scenery_pose(shape))
        if len(self._trail) > 1:
            self._meshcat.SetLine("/play/trail", np.array(self._trail).T, 3.0, _LINE)

    def _say(self) -> None:
        """One line of who commands, when, how well, and what is broken."""
        flight = self.flight
        parts = [f"{flight.controller.name}, {flight.time:.1f} s"]
        for name, error in flight.errors().items():
            scale, unit = QUANTITIES[name].display
            parts.append(f"{name} {scale * error:.1f} {unit}".strip())
        if flight.dead:
            parts.append("dead " + " ".join(map(str, sorted(flight.dead))))
        if flight.stuck:
            parts.append("stuck open " + " ".join(map(str, sorted(flight.stuck))))
        if flight.over:
            parts.append(flight.over)
        elif not self.running:
            parts.append("paused")
        self._report("; ".join(parts))
