"""Words of the field by which the site's search finds a page first, though the page may not have them.

Sphinx ranks main entries of the index before titles and texts: a word that is typed whole has 100 points, a title
16 at most. The entries are hidden, and in no printed index. At its end a build is checked: every word finds its
page first.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from docutils import nodes
    from sphinx.application import Sphinx
    from sphinx.environment import BuildEnvironment

WORDS: dict[str, tuple[str, ...]] = {
    "agents": (
        "pretrained",
        "pretrained agents",
        "limit cycle",
        "chatter",
        "path following",
        "evaluation",
    ),
    "any_craft/any_craft": (
        "any craft",
        "adaptive control",
        "fault detection",
        "fault isolation",
        "foundation policy",
        "generalist policy",
        "zero-shot",
        "set policy",
    ),
    "any_craft/any_craft_judged": (
        "six degrees of freedom",
        "multiple models",
        "random layouts",
        "docked spacecraft",
        "joined bodies",
        "fine-tuning",
        "transfer learning",
    ),
    "assurance/assurance": (
        "failure probability",
        "monte carlo",
        "probability of failure",
        "reliability",
    ),
    "bounds/certificate": ("certified bound", "lower bound", "optimality gap", "certificate"),
    "cluster": ("slurm", "kubernetes", "dask", "mpi"),
    "coming_from": ("isaac", "isaac lab", "isaac gym", "migration"),
    "comparison": ("compare", "baseline", "benchmark against mpc", "comparison with lqr"),
    "conditions": (
        "domain randomization",
        "disturbance",
        "disturbances",
        "latency",
        "valve delay",
        "actuator delay",
        "sensor noise",
        "sensor dropout",
        "observation noise",
        "randomization",
    ),
    "controllers": (
        "lqr",
        "mpc",
        "pid",
        "pd controller",
        "phase plane",
        "phase-plane control",
        "thruster allocation",
        "control allocation",
        "classical control",
    ),
    "dynamics": (
        "units",
        "coordinate frames",
        "equations of motion",
        "integrator",
        "rigid body",
        "quaternion",
    ),
    "environments": (
        "action space",
        "differentiable simulation",
        "observation space",
        "gym",
        "gymnasium",
        "openai gym",
        "stable-baselines3",
        "sb3",
        "cleanrl",
        "rsl_rl",
        "rl_games",
        "skrl",
        "sac",
        "vector environment",
        "vectorized environment",
    ),
    "export": (
        "simulink",
        "c code",
        "onnx",
        "torchscript",
        "embedded c",
        "tensorrt",
        "deployment",
        "microcontroller",
        "model card",
        "test vectors",
    ),
    "assurance/faults": (
        "fault injection",
        "fault tolerance",
        "fault-tolerant control",
        "thruster failure",
        "stuck thruster",
    ),
    "fly": ("javascript", "browser", "live page", "demo"),
    "glossary": ("duty cycle", "dwell time", "settling time", "impulse", "success rate", "delta-v"),
    "robot/identify": ("system identification", "sysid", "parameter estimation"),
    "install": (
        "installation",
        "docker",
        "conda",
        "pip",
        "gpu",
        "cuda",
        "windows",
        "requirements",
        "uv",
    ),
    "choose": ("limitations", "known issues", "contact dynamics", "faq", "which agent"),
    "memory": (
        "kalman filter",
        "state estimation",
        "gru",
        "lstm",
        "recurrent policy",
        "frame stacking",
    ),
    "missions/avoid": ("keep-out zone", "collision avoidance", "obstacle avoidance", "obstacle"),
    "missions/dock": (
        "clohessy-wiltshire",
        "cwh",
        "hill frame",
        "relative motion",
        "relative orbit",
    ),
    "missions/dock-port": ("docking", "approach cone", "docking port", "berthing"),
    "missions/guard": (
        "safety filter",
        "control barrier function",
        "cbf",
        "run time assurance",
        "shield",
        "passive safety",
        "free drift",
        "abort",
    ),
    "missions/hold": ("station keeping", "station-keeping", "formation flying"),
    "missions/inspect": ("inspection", "circumnavigation"),
    "missions/land": ("powered descent", "landing", "lander", "lossless convexification", "g-fold"),
    "missions/orbits": (
        "ccsds",
        "orbit ephemeris",
        "oem",
        "elliptic orbit",
        "eccentricity",
        "tschauner-hempel",
        "yamanaka-ankersen",
        "true anomaly",
        "j2",
        "oblateness",
        "differential drag",
        "schweighart-sedwick",
    ),
    "missions/rendezvous": ("rendezvous", "proximity operations", "rpo"),
    "missions/slosh": ("slosh", "sloshing", "fuel slosh", "pendulum"),
    "optimal": (
        "fuel optimal",
        "optimal control",
        "trajectory optimization",
        "minimum time",
        "minimum fuel",
        "bang-bang",
        "casadi",
        "direct transcription",
    ),
    "own_task": (
        "custom environment",
        "custom task",
        "own task",
        "reward function",
        "curriculum design",
    ),
    "plain": ("debugging", "debugger", "breakpoint"),
    "proof/proofs": (
        "formal verification",
        "neural network verification",
        "reachability",
        "arch-comp",
        "vnn-comp",
    ),
    "python": ("python api", "notebook", "jupyter", "matlab"),
    "robot/raft": ("raft",),
    "robot/robots": (
        "ros",
        "ros 2",
        "ros2",
        "rosbag",
        "bag",
        "mcap",
        "px4",
        "hardware in the loop",
        "sim2real",
        "sim-to-real",
        "sim to real",
        "real robot",
        "zenoh",
    ),
    "assurance/robustness": ("robustness results",),
    "spacecraft": (
        "6dof",
        "3dof",
        "urdf",
        "own spacecraft",
        "custom robot",
        "reaction wheel",
        "reaction wheels",
        "pwm",
        "pulse width modulation",
        "thrusters",
        "air bearing",
        "floating platform",
        "free flyer",
        "inertia",
    ),
    "speed": ("throughput", "steps per second", "fps", "performance"),
    "assurance/stress": ("robustness", "stress test", "sensitivity analysis"),
    "many_gpus": (
        "hyperparameter",
        "hyperparameters",
        "hyper-parameter",
        "hyperparameter search",
        "grid search",
        "random seeds",
        "multi-gpu",
        "optuna",
    ),
    "tasks": ("curriculum", "reward", "reward shaping", "multi-task", "multi-task learning"),
    "terminal": ("command line", "cli", "shell completion"),
    "training": (
        "ppo",
        "imitation learning",
        "behaviour cloning",
        "behavior cloning",
        "asymmetric actor-critic",
        "privileged observation",
        "early stopping",
        "tensorboard",
        "learning rate",
        "checkpoint",
        "resume training",
    ),
    "validation": ("drake", "validation", "mujoco", "cross-validation", "verification"),
    "viewing": ("video", "visualization", "rendering", "animation", "report"),
}
"""Words by page, in lower case; every word belongs to one page."""

_WHOLE = 100.0
"""Points of a main entry of the index that equals what was typed (searchtools.js of Sphinx)."""
_TITLE = 15.0
"""Points of a title that equals what was typed; the title of a page has one more."""


def ranking(index: Mapping[str, Any], typed: str) -> list[tuple[float, str]]:
    """Pages that Sphinx's search ranks for a text by index entries and titles, the best first, with their points.

    Words in texts and names of Python objects are left out: they have less than 50 points.

    Args:
        index: content of searchindex.js.
        typed: text in the field of the search.
    """
    query = typed.lower().strip()
    points: dict[str, float] = {}

    def note(number: int, score: float) -> None:
        page = index["docnames"][number]
        points[page] = max(score, points.get(page, 0.0))

    for entry, places in index["indexentries"].items():
        if query in entry and 2 * len(query) >= len(entry):
            for number, _, is_main in places:
                if is_main:
                    note(number, round(_WHOLE * len(query) / len(entry)))
    for title, places in index["alltitles"].items():
        if query in title.lower().strip() and 2 * len(query) >= len(title):
            for number, _ in places:
                note(
                    number,
                    round(_TITLE * len(query) / len(title)) + (index["titles"][number] == title),
                )
    return sorted(((score, page) for page, score in points.items()), key=lambda x: (-x[0], x[1]))


def read_index(file: Path) -> dict[str, Any]:
    """Content of searchindex.js, a call with one object of JSON."""
    text = file.read_text("utf-8")
    return json.loads(text[text.index("(") + 1 : text.rindex(")")])


def _add(app: Sphinx, doctree: nodes.document) -> None:
    from sphinx import addnodes

    words = WORDS.get(app.env.current_document.docname, ())
    if words:
        entries = [("single", word, "", "main", None) for word in words]
        doctree.insert(0, addnodes.index(entries=entries))


def _outdated(
    app: Sphinx, env: BuildEnvironment, added: set[str], changed: set[str], removed: set[str]
) -> list[str]:
    """Pages with such words, to be read again with any other page.

    A build that reads some pages keeps titles and texts of all pages in the search, but not their index entries.
    """
    del app
    return sorted(WORDS.keys() & env.found_docs) if added or changed or removed else []


def _check(app: Sphinx, error: Exception | None) -> None:
    """Fail a build in which a word does not find its page first."""
    from sphinx.errors import ExtensionError

    file = Path(app.outdir) / "searchindex.js"
    if error is not None or not file.exists():
        return
    index = read_index(file)
    wrong = []
    for page, words in WORDS.items():
        for word in words:
            first, *others = ranking(index, word) or [(0.0, "nothing")]
            if first != (_WHOLE, page) or any(score >= _WHOLE for score, _ in others):
                wrong.append(f"{word!r} finds {first[1]} before {page}")
    if wrong:
        raise ExtensionError(f"the search is not in order: {'; '.join(wrong)}")


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.connect("env-get-outdated", _outdated)
    app.connect("doctree-read", _add)
    app.connect("build-finished", _check)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
