"""What decides in a flight on a robot: from the messages that came, and when, to the commands that go.

It knows no bus and no clock: the same messages at the same times give the same commands, bit for bit. Readings are
in W, spins in B, times in ns; `rans_robot.node` calls it, and `replay_bag` holds it to its bits.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from rans.episode.safety_filters import safety_filter
from rans.evaluation.fly.exported import load_exported
from rans.extend import (
    Ball,
    ConfigError,
    Heading,
    PlanarState,
    Quat,
    RunFolder,
    Setup,
    Spacecraft,
    SpatialState,
    State,
    Task,
    Vec2,
    Vec3,
    World,
    brief,
    first_line,
    inside,
    is_finite,
    positive,
    read_contract,
    read_text,
    reading,
    scenario,
)
from rans.tasks.base import observation
from rans_robot.frames import Motion, heading_of, quaternion_of
from rans_robot.interfaces import (
    Interface,
    Message,
    RobotName,
    read_motion,
)
from rans_robot.messages import POSE, TEXT, text_message
from rans_robot.monitor import RULES, Monitor, description

CRAFT_TOPIC = "rans/craft"
"""Topic on which a robot says which spacecraft it is, as JSON in a text."""
AGENT_TOPIC = "rans/agent"
"""Topic on which a node says which agent it flies and on which topics it commands, as JSON in a text."""
NOTE_TOPIC = "rans/note"
"""Topic on which a node says why valves are shut."""
GOAL_TOPIC = "goal_pose"
"""Topic on which a goal may come, such as RViz's."""


def craft_hash(craft: Spacecraft) -> str:
    """Digest of what a spacecraft is made of: numbers to nine digits, without its name and looks.

    Robots and twins announce it, and a pilot shuts all valves where it is another one: what is hashed is an
    interface.
    """
    table = asdict(craft)
    for key in ("name", "radius", "shape"):
        table.pop(key)

    def rounded(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: rounded(x) for key, x in value.items()}
        if isinstance(value, list | tuple):
            return [rounded(x) for x in value]
        return f"{value + 0.0:.9g}" if isinstance(value, float | int) else value

    text = json.dumps(rounded(table), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class Plan:
    """What a flight is: everything that decides its commands beside the messages."""

    folder: str
    """Folder of the exported agent (`exported_agent`)."""
    task: dict[str, Any]
    """Settings of the task, with its name under "name"."""
    robot: RobotName = "ros"
    """Kind of robot (`rans_robot.interfaces`)."""
    goal: tuple[float, ...] = ()
    """The goal: x, y (m) and heading (degrees) in the plane; x, y, z and roll, pitch, yaw in space. Empty: the
    origin."""
    goal_velocity: tuple[float, ...] = ()
    """Velocity of the goal in W, m/s, and after it its angular velocity, rad/s, for tasks that track one."""
    zones: tuple[float, ...] = ()
    """Keep-out zones that stand still, for tasks that observe some: x, y (in space also z) and radius of each, m.
    A radius includes the spacecraft's own."""
    guard: bool = False
    """Whether the safety filter for the spacecraft and the task (`rans.safety_filters`) stands between the
    agent and the valves."""
    trade_off: float | None = None
    """Trade-off input of agents that have one, 0 (fast) to 1 (thrifty)."""
    pose_noise: tuple[float, float] = (0.002, 0.005)
    """Standard deviation of measured poses, m and rad, for velocities from poses."""
    lost_after: float = 1.0
    """s without a state, or with readings that contradict one another, after which the flight ends; no less than a
    reading may be old."""
    wait: float = 10.0
    """s until the first state has to come."""

    def __post_init__(self) -> None:
        """Reject (`ConfigError`) numbers that are not finite, and times that are not above 0."""
        numbers = {"goal": self.goal, "goal's velocity": self.goal_velocity, "zone": self.zones}
        for what, several in numbers.items():
            if not all(map(is_finite, several)):
                raise ConfigError(f"the numbers of a {what} must be finite, got {several}.")
        positive("lost_after", self.lost_after)
        positive("wait", self.wait)
        # Where noise is taken for all motion, velocities are about 0 at any speed.
        most = RULES["jump"].limits[:2]
        for noise, limit in zip(self.pose_noise, most, strict=True):
            positive("pose_noise", noise)
            if noise > limit:
                raise ConfigError(
                    f"pose_noise is {self.pose_noise}, but must be at most {most[0]:g} m and {most[1]:g} rad: is "
                    "it in m and rad?"
                )


class Decision(NamedTuple):
    """One command, and why it is none of the agent's."""

    command: np.ndarray
    """Commands in the contract's order."""
    note: str = ""
    """One sentence; "" where all is well."""
    over: bool = False
    """Whether the flight ends with this command, which shuts the valves."""
    guarded: bool = False
    """Whether the safety filter gave another command than the agent's."""


def check_plan(plan: Plan, craft: Spacecraft, task: Task, period: float) -> None:
    """Check that a plan fits a spacecraft and its task, before an agent is written for it.

    Args:
        plan: its folder is not looked at.
        craft: the agent's spacecraft.
        task: the agent's task.
        period: the agent's control period, s.

    Raises:
        ConfigError: it does not, as `MessagePilot` says.
    """
    Interface(plan.robot, craft.command_count, craft.thruster_count)
    task = _with_trade_off(task, plan.trade_off)
    _goal(craft, task, plan)
    if plan.guard:
        setup = Setup(craft, task, replace(task.timing, control_period=period))
        safety_filter(setup)


class MessagePilot:
    """Turns messages into states, and states into commands.

    Args:
        plan: what to fly.
        task: the task of the plan.
        link: bus and domain over which messages come, as sentences name them; "" leaves them out.

    Raises:
        ConfigError: the agent's files do not fit one another, or the plan does not fit the agent.
    """

    def __init__(self, plan: Plan, task: Task, link: str = "") -> None:
        # The agent, its craft and its contract, and how messages of this robot become states.
        self.plan = plan
        folder = Path(plan.folder)
        self.contract = read_contract(folder)
        self.craft = RunFolder(folder).spacecraft()
        self.period = float(self.contract["control_period"])
        self.agent = exported_agent(folder)
        self.interface = Interface(plan.robot, self.craft.command_count, self.craft.thruster_count)
        self.inputs = {**self.interface.inputs, CRAFT_TOPIC: TEXT, GOAL_TOPIC: POSE}
        # The goal, and what filters commands and readings.
        self._task = _with_trade_off(task, plan.trade_off)
        self._goal = _goal(self.craft, self._task, plan)
        self.errors: dict[str, float] = {}
        """Errors of the task at the last decision, SI units, by name."""
        self._goal_came: int | None = None
        """Time of the goal, ns, from which on it moves; None: the first decision."""
        self._world: World | None = None
        if plan.guard:
            timing = replace(self._task.timing, control_period=self.period)
            setup = Setup(self.craft, self._task, timing)
            self._world = World(setup._replace(guard=safety_filter(setup)))
        self._hash = craft_hash(self.craft)
        self.monitor = Monitor(self.craft, self.contract, self.interface, plan, link)
        # What has come, and what was wrong with it.
        self._began: int | None = None
        self._resting = True
        """Whether the agent's next command is the first of an episode."""
        self._fault = ""
        self._troubles: dict[str, str] = {}
        """What was wrong with messages since the last decision, in a sentence of each topic."""

    def receive(self, topic: str, data: bytes, now: int) -> None:
        """Take a message that came at a time, ns.

        What is wrong is remembered as a sentence, and nothing is raised.
        """
        try:
            if topic == CRAFT_TOPIC:
                self._check_craft(data)
            elif topic == GOAL_TOPIC:
                self._take_goal(data, now)
            elif topic in self.interface.inputs and (
                note := self.monitor.take(topic, self.interface.read(topic, data), now)
            ):
                self._troubles[topic] = f"{topic}: {note}."
        except ValueError as error:
            end = "" if str(error).endswith("?") else "."
            self._troubles[topic] = f"{topic}: {error}{end}"
            self.monitor.refuse(topic, now, f"its messages are refused: {error}")

    def _take_goal(self, data: bytes, now: int) -> None:
        """Take a goal at a time, ns: sets it, and lets the agent begin anew (`ValueError` if it is wrong).

        All that may be refused is before what changes: a refused goal leaves that before.
        """
        reading: Any = read_motion(POSE, data)
        self.monitor.validator.pose(GOAL_TOPIC, reading)
        still = np.zeros(3)
        there = state_of(self.craft, Motion(reading.position, reading.attitude, still, still))
        self._goal = replace(self._goal, p=there.p, attitude=there.attitude)
        self._goal_came = now
        # An episode has one goal: to another begins another one.
        self._resting = True

    def _check_craft(self, data: bytes) -> None:
        """Compare the robot's spacecraft with the agent's; a difference is a fault that ends the flight.

        It sets `_fault`, which `decide` answers by shut valves.
        """
        name, digest, period = description(data)
        if digest != self._hash:
            self._fault = (
                f"the robot is the spacecraft {name} ({brief(digest[:8])}), but the agent was trained "
                f"for {self.craft.name} ({self._hash[:8]})"
            )
        elif not abs(period - self.period) <= RULES["craft"].limits[0]:
            self._fault = (
                f"the robot takes a command every {period:g} s, but the agent gives one every "
                f"{self.period:g} s"
            )

    def decide(self, now: int) -> Decision:
        """The command of the control period that begins at a time, ns.

        Wrong or old readings shut all valves; it may reset the agent, and forgets troubles that it says.
        """
        decision = self._decide(now)
        self.monitor.gave(decision.command)
        return decision

    def overrule(self, late: float) -> Decision:
        """The decision in place of one that came so many s too late to be sent: its memory is of another flight."""
        self._resting = True
        self.monitor.gave(np.zeros(self.craft.command_count))
        return self._shut(f"the agent's command came {late:.2f} s after it was due")

    def _shut(self, why: str, over: bool = False) -> Decision:
        """Shut valves, with the reason; the agent begins anew after it."""
        self._resting = True
        return Decision(np.zeros(self.craft.command_count), f"{why}: valves shut.", over)

    def _decide(self, now: int) -> Decision:
        # Without a state, or after a fault, all valves are shut.
        self._began = now if self._began is None else self._began
        troubles = self._troubles
        self._troubles = {}
        if self._fault:
            return self._shut(self._fault, over=True)
        if unfit := self.monitor.unfit(now):
            shut = self._shut(*unfit)
            others = [
                text for topic, text in troubles.items() if topic not in self.interface.inputs
            ]
            return shut._replace(note=" ".join([shut.note, *others]))
        if self._resting:
            self.agent.reset()
            self._resting = False
        # The agent's command for the goal as it is now.
        state = state_of(self.craft, Motion(**self.monitor.reading))
        since = self._began if self._goal_came is None else self._goal_came
        goal = self._task.later(self._goal, (now - since) * 1e-9)
        self.errors = {name: float(error) for name, error in self._task.errors(state, goal).items()}
        try:
            row = self.monitor.observed(observation(self._task, state, goal))
            given = self.monitor.commanded(self.agent.act(row))
        except (ValueError, ConfigError) as error:
            return self._shut(f"the agent: {str(error).rstrip('.')}")
        note = " ".join(troubles.values()) or self.agent.note
        if self._world is None:
            return Decision(given, note)
        # The safety filter has the last word.
        guard = self._world.setup.guard
        assert guard is not None
        wanted = tuple(given.tolist())
        admitted, changed = guard.admitted(self._world, state, goal, wanted)
        if changed:
            note = note or "the safety filter replaced the command."
        return Decision(np.array(admitted, dtype=float), note, guarded=bool(changed))

    def messages(self, decision: Decision, now: int) -> list[Message]:
        """What goes over the bus for a decision."""
        sent = self.interface.command(decision.command.tolist(), now)
        if decision.note:
            sent.append(Message(NOTE_TOPIC, TEXT, text_message(decision.note)))
        return sent

    def shut(self, now: int) -> list[Message]:
        """What goes over the bus to shut all valves."""
        return self.interface.command([0.0] * self.craft.command_count, now)


def state_of(craft: Spacecraft, motion: Motion) -> State:
    """State of a craft as tasks take it, of plain numbers, from a motion in W (spin in B).

    Stores are those at first.
    """
    p = [float(x) for x in motion.position]
    v = [float(x) for x in motion.velocity]
    w = [float(x) for x in motion.spin]
    stores = tuple(store.initial for store in craft.stores)
    if craft.dimension == 2:
        return PlanarState(
            Vec2(*p[:2]), Heading(heading_of(motion.attitude)), Vec2(*v[:2]), w[2], stores=stores
        )
    attitude = Quat(*(float(x) for x in motion.attitude))
    return SpatialState(Vec3(*p), attitude, Vec3(*v), Vec3(*w), stores=stores)


def motion_of(state: Any) -> Motion:
    """Motion, arrays (3,) and a quaternion, of a state of numbers.

    In the plane z, and spins about x and y, are 0.
    """
    if isinstance(state.w, Vec3):
        q = state.attitude
        attitude = np.array([q.w, q.x, q.y, q.z], dtype=float)
        return Motion(
            np.array(state.p.columns(), dtype=float),
            attitude,
            np.array(state.v.columns(), dtype=float),
            np.array(state.w.columns(), dtype=float),
        )
    return Motion(
        np.array([state.p.x, state.p.y, 0.0], dtype=float),
        quaternion_of(float(state.attitude.angle)),
        np.array([state.v.x, state.v.y, 0.0], dtype=float),
        np.array([0.0, 0.0, state.w], dtype=float),
    )


class _Network:
    """An exported agent.onnx, asked for one spacecraft by ONNX Runtime."""

    note = ""

    def __init__(self, folder: Path) -> None:
        self._policy: Any = load_exported(folder).controller
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        self._memory: Any = None

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Commands (n,) for an observation (width,), float32."""
        commands, self._memory = self._policy.decide(observation[None], self._memory)
        return commands[0]


def runs_code(folder: Path) -> bool:
    """Whether the agent of an exported folder is agent.py, whose code a flight runs."""
    return not (folder / "agent.onnx").exists()


def code_of(file: Path) -> ModuleType:
    """Module of an exported agent.py, from the text of this file.

    Python's own import would run a ``__pycache__`` beside it in its place, which a user who has read agent.py and
    trusts it has not seen.

    Raises:
        ConfigError: the file cannot be read, or its code fails.
    """
    text = read_text(file)
    module = ModuleType(file.stem)
    module.__file__ = str(file)
    with _failing(file):
        exec(compile(text, str(file), "exec", dont_inherit=True), module.__dict__)
    return module


@contextmanager
def _failing(file: Path) -> Iterator[None]:
    """Context that converts whatever the code of an exported agent.py raises to a `ConfigError`."""
    try:
        yield
    except ConfigError:
        raise
    except (Exception, SystemExit) as error:  # somebody else's code raises anything
        raise ConfigError(
            f"{file} cannot be loaded: {type(error).__name__}: {first_line(error)}."
        ) from error


def exported_agent(folder: Path) -> Any:
    """The agent of an exported folder, whose golden pairs come out as they should.

    It has ``reset()``, ``act(observation)`` and the sentence ``note``. It is the network agent.onnx, or the
    code of agent.py (`runs_code`).

    Raises:
        ConfigError: files are missing, or some pairs do not come out as they should.
    """
    file = inside(folder, "agent.py")
    if not runs_code(folder):
        agent: Any = _Network(folder)
        file = inside(folder, "golden.json")
        with reading(file) as pairs:
            right, count = _right_pairs(agent, pairs)
    elif not (file.exists() and (folder / "agent.npz").exists()):
        raise ConfigError(
            f"{folder} has no agent.onnx, and no agent.py with agent.npz: write it with rans export --format onnx, "
            "or numpy."
        )
    else:
        module = code_of(file)
        with _failing(file):
            right, count = module.check()
            agent = module.Agent()
    if right != count:
        raise ConfigError(
            f"{count - right} of {count} golden pairs of {folder} come out wrong: its files are of "
            "different agents or versions, or damaged. Write it anew, by rans export."
        )
    agent.reset()
    return agent


def _right_pairs(agent: Any, pairs: Any) -> tuple[int, int]:
    """How many golden pairs (`rans.deploy.contract.golden`) an agent gives, and how many there are."""
    right = 0
    rows = zip(pairs["begins"], pairs["observation"], pairs["command"], strict=True)
    for begins, row, expected in rows:
        if begins:
            agent.reset()
        given = agent.act(np.array(row, np.float32))
        right += bool(np.abs(given - np.array(expected)).max() <= pairs["tolerance"])
    return right, len(pairs["begins"])


def _with_trade_off(task: Task, trade_off: float | None) -> Task:
    """The task with its trade-off input held."""
    if task.draws_trade_off or task.held_trade_off is not None:
        return task.with_trade_off(0.5 if trade_off is None else trade_off)
    if trade_off is not None:
        raise ConfigError("this agent has no trade-off input.")
    return task


def _goal(craft: Spacecraft, task: Task, plan: Plan) -> State:
    """Goal of a plan: position (m) and angles (degrees), velocities, and what the task's goals have beside them.

    Numbers are m and degrees, velocities m/s and rad/s in the order of a state.
    """
    return placed(craft, "goal", plan.goal, plan.goal_velocity, _notes(craft, task, plan))


def placed(
    craft: Spacecraft,
    what: str,
    pose: tuple[float, ...],
    speeds: tuple[float, ...] = (),
    notes: Any = None,
) -> State:
    """State of a craft from numbers; those that are left out are 0.

    Args:
        craft: in the plane or in space.
        what: "goal" or "start", for messages.
        pose: x, y (m) and heading (degrees); in space x, y, z and roll, pitch, yaw.
        speeds: velocity in W, m/s, and after it the angular velocity in B, rad/s.
        notes: what a goal has beside its motion.

    Raises:
        ConfigError: there are others than three numbers of each in the plane, or six in space.
    """
    wanted = 3 if craft.dimension == 2 else 6
    numbers = [*pose] or [0.0] * wanted
    rates = [*speeds] or [0.0] * wanted
    if (len(numbers), len(rates)) != (wanted, wanted):
        names = "x, y and heading" if wanted == 3 else "x, y, z, roll, pitch and yaw"
        raise ConfigError(
            f"a {what} is {wanted} numbers, {names}, and has as many velocities, got {len(numbers)} and "
            f"{len(rates)}."
        )
    if wanted == 3:
        x, y, heading = numbers
        vx, vy, w = rates
        return PlanarState(Vec2(x, y), Heading(float(np.radians(heading))), Vec2(vx, vy), w, notes)
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_euler("xyz", numbers[3:], degrees=True)
    attitude = Quat(*turn.as_quat(scalar_first=True).tolist())
    return SpatialState(Vec3(*numbers[:3]), attitude, Vec3(*rates[:3]), Vec3(*rates[3:]), notes)


def _notes(craft: Spacecraft, task: Task, plan: Plan) -> Any:
    """Data of a goal that an agent observes beside its pose: its trade-off, or keep-out zones.

    Where the task has zones, all of them must be given: the network has columns for so many.
    """
    name = type(task).__name__
    sampled = scenario(task, craft.dimension, seed=0, episode=0).goal.notes
    zones = getattr(sampled, "zones", ())
    if not zones:
        if plan.zones:
            raise ConfigError(f"{name} has no keep-out zones: leave out --zones.")
        if task.held_trade_off is not None:
            return replace(sampled, trade_off=task.held_trade_off)
        if sampled is not None:
            raise ConfigError(
                f"goals of {name} have data that no robot publishes, such as a deadline: rans fly flies agents "
                "whose goal is a pose, a velocity, or a pose among keep-out zones."
            )
        return None
    size = craft.dimension + 1
    rows = [plan.zones[k : k + size] for k in range(0, len(plan.zones), size)]
    if len(plan.zones) != size * len(zones) or any(row[-1] <= 0.0 for row in rows):
        names = "x, y and radius" if craft.dimension == 2 else "x, y, z and radius"
        raise ConfigError(
            f"--zones are {names} (m, above 0) of each of the {len(zones)} zones that the agent observes, "
            f"{size * len(zones)} numbers, got {plan.zones}: zones far away stand for those that are not there."
        )
    vector = Vec2 if craft.dimension == 2 else Vec3
    still = vector(*(0.0,) * craft.dimension)
    balls = tuple(Ball(vector(*row[:-1]), still, row[-1]) for row in rows)
    return replace(sampled, zones=balls)
