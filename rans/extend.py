"""What packages and plug-ins build on: what two of their modules use, and what entry points take and give.

    >>> from rans.extend import ConfigError, Flight, Spacecraft

A package imports these from here, so that the core may move them: values and their fields, tasks and observations,
effectors and drifts, Drake's halves, flights and scores, learners, exports, sections of pages, commands. What one
module needs beyond them it imports from its module in the core, without a promise. Each is imported on first use.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from rans.base.display import meanings
from rans.base.lazy import homes

if TYPE_CHECKING:
    from rans.api.judging import SpacecraftLike as SpacecraftLike
    from rans.base.errors import (
        ConfigError as ConfigError,
        NonFiniteState as NonFiniteState,
        brief as brief,
        checked as checked,
        counted as counted,
        is_finite as is_finite,
        is_installed as is_installed,
        one_of as one_of,
        positive as positive,
        require as require,
        whole as whole,
    )
    from rans.base.files import (
        distinct as distinct,
        environment as environment,
        first_line as first_line,
        inside as inside,
        read_bytes as read_bytes,
        read_text as read_text,
        reading as reading,
        ready_folder as ready_folder,
        replace_file as replace_file,
        write_json as write_json,
        write_text as write_text,
    )
    from rans.base.processes import Workers as Workers
    from rans.base.progress import (
        Progress as Progress,
        Stages as Stages,
        unseen as unseen,
        unseen_stages as unseen_stages,
    )
    from rans.base.registry import typed as typed
    from rans.base.settled import settled_alone as settled_alone
    from rans.base.structure import read_toml as read_toml, structure as structure
    from rans.base.table import Table as Table
    from rans.base.terminal import (
        Terminal as Terminal,
        doing as doing,
        progress as progress,
        stages as stages,
    )
    from rans.cli.door import (
        POSE as POSE,
        Options as Options,
        command_of as command_of,
        word as word,
    )
    from rans.compile.step_program import StepProgram as StepProgram
    from rans.control.allocation import inertia as inertia
    from rans.control.regulator import ModelBased as ModelBased
    from rans.deploy.columns import written_columns as written_columns
    from rans.deploy.forms import FORMATS as FORMATS, Format as Format
    from rans.deploy.program import Ports as Ports
    from rans.effectors.commands import action_space as action_space, per_velocity as per_velocity
    from rans.effectors.effector import (
        Action as Action,
        Begun as Begun,
        Effector as Effector,
        JointMotion as JointMotion,
        Push as Push,
    )
    from rans.episode.environment import observation_space as observation_space
    from rans.episode.flight import Controller as Controller, Flight as Flight, fly as fly
    from rans.episode.flight_statistics import FlightStatistics as FlightStatistics
    from rans.episode.scenario import (
        EVALUATION_SEED as EVALUATION_SEED,
        Scenario as Scenario,
        draws as draws,
        each as each,
        scenario as scenario,
    )
    from rans.episode.step import (
        Command as Command,
        Guard as Guard,
        Mover as Mover,
        Setup as Setup,
        World as World,
        step as step,
    )
    from rans.episode.verdict import Failure as Failure, last_fifth as last_fifth
    from rans.evaluation.compare.bounds import (
        Bound as Bound,
        Event as Event,
        check_certifiable as check_certifiable,
        check_period as check_period,
        rounded_up as rounded_up,
    )
    from rans.evaluation.compare.certificates import certificates as certificates
    from rans.evaluation.compare.contest import Contest as Contest
    from rans.evaluation.compare.run import Comparison as Comparison
    from rans.evaluation.fly.agent import LoadedRun as LoadedRun
    from rans.evaluation.fly.contestant_name import ContestantName as ContestantName
    from rans.evaluation.fly.contestants import (
        contestant as contestant,
        view_command as view_command,
    )
    from rans.evaluation.fly.episodes import fly_draws as fly_draws
    from rans.evaluation.fly.exported import read_contract as read_contract
    from rans.evaluation.fly.policy_text import ForeignPolicy as ForeignPolicy
    from rans.evaluation.measure.aggregate import Metrics as Metrics
    from rans.evaluation.measure.metrics import (
        Sample as Sample,
        impulses as impulses,
        won as won,
        worst_errors as worst_errors,
    )
    from rans.evaluation.measure.statistics import WANTED as WANTED, Estimate as Estimate
    from rans.evaluation.problems import Problem as Problem
    from rans.fast.device import torch_device as torch_device
    from rans.fast.learn.adam import Adam as Adam
    from rans.fast.learn.algorithms import Algorithm as Algorithm
    from rans.fast.learn.batch import Batch as Batch, Losses as Losses, LossInputs as LossInputs
    from rans.fast.learn.config import (
        TrainConfig as TrainConfig,
        craft_of as craft_of,
    )
    from rans.fast.learn.graph import fused as fused
    from rans.fast.learn.rollout import (
        Acted as Acted,
        Rollout as Rollout,
        gae as gae,
        remember as remember,
    )
    from rans.fast.learn.run_folder import RunFolder as RunFolder
    from rans.fast.machine_code import MachineCode as MachineCode
    from rans.fast.stepping.step import Step as Step
    from rans.model import fields as fields
    from rans.model.actuators import ON_OFF as ON_OFF, Throttle as Throttle
    from rans.model.body import Body as Body
    from rans.model.coordinates import (
        around as around,
        coordinates as coordinates,
        rotation_vector as rotation_vector,
    )
    from rans.model.drift import (
        FREE as FREE,
        AnyVector as AnyVector,
        ClohessyWiltshire as ClohessyWiltshire,
        Drift as Drift,
        step_goal as step_goal,
    )
    from rans.model.dynamics import (
        PlanarState as PlanarState,
        SpatialState as SpatialState,
        State as State,
        Wrench as Wrench,
        advance as advance,
    )
    from rans.model.fields import (
        Field as Field,
        Heading as Heading,
        Quat as Quat,
        Vec2 as Vec2,
        Vec3 as Vec3,
        Vector as Vector,
        absolute as absolute,
        at_least as at_least,
        atan2 as atan2,
        cos as cos,
        floor as floor,
        leaves as leaves,
        map_leaves as map_leaves,
        sin as sin,
        sqrt as sqrt,
        unflatten as unflatten,
        where as where,
        within as within,
        wrap as wrap,
    )
    from rans.model.operations import Dialect as Dialect
    from rans.model.random import Draws as Draws, Random as Random, seed_words as seed_words
    from rans.model.spacecraft import (
        CommandRange as CommandRange,
        Spacecraft as Spacecraft,
        Store as Store,
    )
    from rans.model.spacecraft_file import to_toml as to_toml
    from rans.model.timing import MOST_STEPS as MOST_STEPS, Timing as Timing
    from rans.model.trace import Symbol as Symbol, ordered as ordered
    from rans.policy.activations import ACTIVATIONS as ACTIVATIONS
    from rans.policy.adaptation import Rows as Rows
    from rans.policy.architecture import EXTRACTOR as EXTRACTOR, Architecture as Architecture
    from rans.policy.backbones import AnyCraftBackbone as AnyCraftBackbone
    from rans.policy.capabilities import Capabilities as Capabilities
    from rans.policy.frame_rotation import (
        cross as cross,
        vector_in_rotated_frame as vector_in_rotated_frame,
    )
    from rans.policy.heads import Patterns as Patterns
    from rans.policy.network import Network as Network
    from rans.policy.preprocess import (
        ColumnExecutor as ColumnExecutor,
        TorchPreprocessor as TorchPreprocessor,
    )
    from rans.policy.program import Program as Program, RowStep as RowStep, inputs as inputs
    from rans.policy.subsets import subsets as subsets
    from rans.randomization.conditions import (
        bounds as bounds,
        largest as largest,
    )
    from rans.randomization.conditions_file import conditions_text as conditions_text
    from rans.randomization.parameters import StepInputs as StepInputs
    from rans.reference.frames import DrakeFrame as DrakeFrame
    from rans.reference.further import (
        DrakeEffector as DrakeEffector,
        DrakeMass as DrakeMass,
        Pushing as Pushing,
    )
    from rans.show.pages.chart import Chart as Chart, Mark as Mark, Series as Series
    from rans.show.pages.notebook import html_of as html_of
    from rans.show.pages.page import (
        Fact as Fact,
        Page as Page,
        Part as Part,
        Picture as Picture,
        Section as Section,
        say as say,
    )
    from rans.show.progress import watched as watched
    from rans.tasks.base import SingleTask as SingleTask, Task as Task
    from rans.tasks.derived import (
        example_state as example_state,
        is_constrained as is_constrained,
        observation_width as observation_width,
    )
    from rans.tasks.goal_set import REST_SPEED as REST_SPEED, REST_SPIN as REST_SPIN, aims as aims
    from rans.tasks.observation_terms import (
        AngularVelocity as AngularVelocity,
        Block as Block,
        Columns as Columns,
        Dimension as Dimension,
        Information as Information,
        InformationInW as InformationInW,
        Layout as Layout,
        ObservationTerm as ObservationTerm,
        RelativeRotation as RelativeRotation,
        Scalar as Scalar,
        VectorInW as VectorInW,
    )
    from rans.tasks.quantities import (
        QUANTITIES as QUANTITIES,
        Quantity as Quantity,
        declare as declare,
    )
    from rans.tasks.rewards import (
        Transition as Transition,
        is_used as is_used,
        nearness as nearness,
        speed as speed,
    )
    from rans.tasks.shapes import (
        Ball as Ball,
        Cone as Cone,
        Shape as Shape,
        SpeedLimit as SpeedLimit,
    )

_HOMES = homes(__file__)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        found = getattr(importlib.import_module(_HOMES[name]), name)
        is_row = isinstance(found, type) and hasattr(found, "_fields")
        if is_row and isinstance(text := vars(found)["__doc__"], str):
            found.__doc__ = _WithFields(text)
        return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


class _WithFields:
    """Docstring of a NamedTuple with those of its fields, for which Python's `help` has none.

    Their source is read where somebody asks for it.
    """

    def __init__(self, text: str) -> None:
        self._text = text

    def __get__(self, _: object, described: type) -> str:
        fields = (f"{name}: {meaning}" for name, meaning in meanings(described).items())
        return "\n\n".join((self._text, *(f"    {field}" for field in fields)))


def __dir__() -> list[str]:
    return sorted(_HOMES)
