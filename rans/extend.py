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
    from rans.base.errors import ConfigError as ConfigError
    from rans.base.errors import NonFiniteState as NonFiniteState
    from rans.base.errors import SolverFailed as SolverFailed
    from rans.base.errors import brief as brief
    from rans.base.errors import checked as checked
    from rans.base.errors import counted as counted
    from rans.base.errors import is_finite as is_finite
    from rans.base.errors import is_installed as is_installed
    from rans.base.errors import one_of as one_of
    from rans.base.errors import positive as positive
    from rans.base.errors import require as require
    from rans.base.errors import whole as whole
    from rans.base.files import distinct as distinct
    from rans.base.files import environment as environment
    from rans.base.files import first_line as first_line
    from rans.base.files import inside as inside
    from rans.base.files import read_bytes as read_bytes
    from rans.base.files import read_text as read_text
    from rans.base.files import reading as reading
    from rans.base.files import ready_folder as ready_folder
    from rans.base.files import replace_file as replace_file
    from rans.base.files import write_json as write_json
    from rans.base.files import write_text as write_text
    from rans.base.processes import Workers as Workers
    from rans.base.progress import Progress as Progress
    from rans.base.progress import Stages as Stages
    from rans.base.progress import unseen as unseen
    from rans.base.progress import unseen_stages as unseen_stages
    from rans.base.registry import typed as typed
    from rans.base.settled import settled_alone as settled_alone
    from rans.base.structure import read_toml as read_toml
    from rans.base.structure import structure as structure
    from rans.base.table import Table as Table
    from rans.base.terminal import Terminal as Terminal
    from rans.base.terminal import doing as doing
    from rans.base.terminal import progress as progress
    from rans.base.terminal import stages as stages
    from rans.cli.door import POSE as POSE
    from rans.cli.door import Options as Options
    from rans.cli.door import command_of as command_of
    from rans.cli.door import word as word
    from rans.compile.step_program import StepProgram as StepProgram
    from rans.control.allocation import inertia as inertia
    from rans.control.regulator import ModelBased as ModelBased
    from rans.deploy.columns import written_columns as written_columns
    from rans.deploy.forms import FORMATS as FORMATS
    from rans.deploy.forms import Format as Format
    from rans.deploy.program import Ports as Ports
    from rans.effectors.commands import action_space as action_space
    from rans.effectors.commands import per_velocity as per_velocity
    from rans.effectors.effector import Action as Action
    from rans.effectors.effector import Begun as Begun
    from rans.effectors.effector import Effector as Effector
    from rans.effectors.effector import JointMotion as JointMotion
    from rans.effectors.effector import Push as Push
    from rans.episode.environment import observation_space as observation_space
    from rans.episode.flight import Controller as Controller
    from rans.episode.flight import Flight as Flight
    from rans.episode.flight import fly as fly
    from rans.episode.flight_statistics import FlightStatistics as FlightStatistics
    from rans.episode.scenario import EVALUATION_SEED as EVALUATION_SEED
    from rans.episode.scenario import Scenario as Scenario
    from rans.episode.scenario import draws as draws
    from rans.episode.scenario import each as each
    from rans.episode.scenario import scenario as scenario
    from rans.episode.scenario import scenarios as scenarios
    from rans.episode.step import Command as Command
    from rans.episode.step import Guard as Guard
    from rans.episode.step import Mover as Mover
    from rans.episode.step import Setup as Setup
    from rans.episode.step import World as World
    from rans.episode.step import step as step
    from rans.episode.verdict import Failure as Failure
    from rans.episode.verdict import last_fifth as last_fifth
    from rans.evaluation.compare.bounds import Bound as Bound
    from rans.evaluation.compare.bounds import Event as Event
    from rans.evaluation.compare.bounds import check_certifiable as check_certifiable
    from rans.evaluation.compare.bounds import check_finite as check_finite
    from rans.evaluation.compare.bounds import check_period as check_period
    from rans.evaluation.compare.bounds import rounded_up as rounded_up
    from rans.evaluation.compare.certificates import certificates as certificates
    from rans.evaluation.compare.contest import Contest as Contest
    from rans.evaluation.compare.run import Comparison as Comparison
    from rans.evaluation.fly.agent import LoadedRun as LoadedRun
    from rans.evaluation.fly.contestant_name import ContestantName as ContestantName
    from rans.evaluation.fly.contestants import contestant as contestant
    from rans.evaluation.fly.contestants import view_command as view_command
    from rans.evaluation.fly.episodes import fly_draws as fly_draws
    from rans.evaluation.fly.exported import read_contract as read_contract
    from rans.evaluation.fly.policy_text import ForeignPolicy as ForeignPolicy
    from rans.evaluation.measure.aggregate import Metrics as Metrics
    from rans.evaluation.measure.metrics import Sample as Sample
    from rans.evaluation.measure.metrics import impulses as impulses
    from rans.evaluation.measure.metrics import won as won
    from rans.evaluation.measure.metrics import worst_errors as worst_errors
    from rans.evaluation.measure.statistics import WANTED as WANTED
    from rans.evaluation.measure.statistics import Estimate as Estimate
    from rans.evaluation.problems import Problem as Problem
    from rans.fast.device import torch_device as torch_device
    from rans.fast.learn.adam import Adam as Adam
    from rans.fast.learn.algorithms import Algorithm as Algorithm
    from rans.fast.learn.batch import Batch as Batch
    from rans.fast.learn.batch import Losses as Losses
    from rans.fast.learn.batch import LossInputs as LossInputs
    from rans.fast.learn.config import PPOSettings as PPOSettings
    from rans.fast.learn.config import TrainConfig as TrainConfig
    from rans.fast.learn.config import craft_of as craft_of
    from rans.fast.learn.graph import fused as fused
    from rans.fast.learn.rollout import Acted as Acted
    from rans.fast.learn.rollout import Rollout as Rollout
    from rans.fast.learn.rollout import remember as remember
    from rans.fast.learn.run_folder import RunFolder as RunFolder
    from rans.fast.machine_code import MachineCode as MachineCode
    from rans.fast.stepping.step import Step as Step
    from rans.model import fields as fields
    from rans.model.actuators import ON_OFF as ON_OFF
    from rans.model.actuators import Throttle as Throttle
    from rans.model.body import Body as Body
    from rans.model.coordinates import around as around
    from rans.model.coordinates import coordinates as coordinates
    from rans.model.coordinates import rotation_vector as rotation_vector
    from rans.model.drift import FREE as FREE
    from rans.model.drift import AnyVector as AnyVector
    from rans.model.drift import ClohessyWiltshire as ClohessyWiltshire
    from rans.model.drift import Drift as Drift
    from rans.model.drift import cosine as cosine
    from rans.model.drift import sine as sine
    from rans.model.drift import step_goal as step_goal
    from rans.model.dynamics import PlanarState as PlanarState
    from rans.model.dynamics import SpatialState as SpatialState
    from rans.model.dynamics import State as State
    from rans.model.dynamics import Wrench as Wrench
    from rans.model.dynamics import advance as advance
    from rans.model.fields import Field as Field
    from rans.model.fields import Heading as Heading
    from rans.model.fields import Quat as Quat
    from rans.model.fields import Vec2 as Vec2
    from rans.model.fields import Vec3 as Vec3
    from rans.model.fields import Vector as Vector
    from rans.model.fields import absolute as absolute
    from rans.model.fields import at_least as at_least
    from rans.model.fields import atan2 as atan2
    from rans.model.fields import cos as cos
    from rans.model.fields import floor as floor
    from rans.model.fields import leaves as leaves
    from rans.model.fields import map_leaves as map_leaves
    from rans.model.fields import sin as sin
    from rans.model.fields import sqrt as sqrt
    from rans.model.fields import unflatten as unflatten
    from rans.model.fields import where as where
    from rans.model.fields import within as within
    from rans.model.fields import wrap as wrap
    from rans.model.operations import Dialect as Dialect
    from rans.model.random import Draws as Draws
    from rans.model.random import Random as Random
    from rans.model.random import seed_words as seed_words
    from rans.model.spacecraft import CommandRange as CommandRange
    from rans.model.spacecraft import Spacecraft as Spacecraft
    from rans.model.spacecraft import Store as Store
    from rans.model.spacecraft_file import to_toml as to_toml
    from rans.model.timing import MOST_STEPS as MOST_STEPS
    from rans.model.timing import Timing as Timing
    from rans.model.trace import Symbol as Symbol
    from rans.model.trace import ordered as ordered
    from rans.policy.activations import ACTIVATIONS as ACTIVATIONS
    from rans.policy.adaptation import Rows as Rows
    from rans.policy.architecture import EXTRACTOR as EXTRACTOR
    from rans.policy.architecture import Architecture as Architecture
    from rans.policy.backbones import AnyCraftBackbone as AnyCraftBackbone
    from rans.policy.capabilities import Capabilities as Capabilities
    from rans.policy.frame_rotation import cross as cross
    from rans.policy.frame_rotation import vector_in_rotated_frame as vector_in_rotated_frame
    from rans.policy.heads import Patterns as Patterns
    from rans.policy.network import Network as Network
    from rans.policy.preprocess import ColumnExecutor as ColumnExecutor
    from rans.policy.preprocess import TorchPreprocessor as TorchPreprocessor
    from rans.policy.program import Program as Program
    from rans.policy.program import RowStep as RowStep
    from rans.policy.program import inputs as inputs
    from rans.policy.subsets import subsets as subsets
    from rans.randomization.conditions import Conditions as Conditions
    from rans.randomization.conditions import bounds as bounds
    from rans.randomization.conditions import largest as largest
    from rans.randomization.conditions_file import conditions_text as conditions_text
    from rans.randomization.parameters import StepInputs as StepInputs
    from rans.reference.frames import DrakeFrame as DrakeFrame
    from rans.reference.further import DrakeMass as DrakeMass
    from rans.show.pages.chart import Chart as Chart
    from rans.show.pages.chart import Mark as Mark
    from rans.show.pages.chart import Series as Series
    from rans.show.pages.notebook import html_of as html_of
    from rans.show.pages.page import Fact as Fact
    from rans.show.pages.page import Page as Page
    from rans.show.pages.page import Part as Part
    from rans.show.pages.page import Picture as Picture
    from rans.show.pages.page import Section as Section
    from rans.show.pages.page import say as say
    from rans.show.progress import watched as watched
    from rans.tasks.base import SingleTask as SingleTask
    from rans.tasks.base import Task as Task
    from rans.tasks.derived import example_state as example_state
    from rans.tasks.derived import is_constrained as is_constrained
    from rans.tasks.derived import observation_width as observation_width
    from rans.tasks.goal_set import REST_SPEED as REST_SPEED
    from rans.tasks.goal_set import REST_SPIN as REST_SPIN
    from rans.tasks.goal_set import aims as aims
    from rans.tasks.observation_terms import AdvisedVelocityChange as AdvisedVelocityChange
    from rans.tasks.observation_terms import AngularVelocity as AngularVelocity
    from rans.tasks.observation_terms import Block as Block
    from rans.tasks.observation_terms import Columns as Columns
    from rans.tasks.observation_terms import Dimension as Dimension
    from rans.tasks.observation_terms import Information as Information
    from rans.tasks.observation_terms import InformationInW as InformationInW
    from rans.tasks.observation_terms import Layout as Layout
    from rans.tasks.observation_terms import ObservationTerm as ObservationTerm
    from rans.tasks.observation_terms import RelativeRotation as RelativeRotation
    from rans.tasks.observation_terms import Scalar as Scalar
    from rans.tasks.observation_terms import VectorInW as VectorInW
    from rans.tasks.quantities import QUANTITIES as QUANTITIES
    from rans.tasks.quantities import Quantity as Quantity
    from rans.tasks.quantities import declare as declare
    from rans.tasks.rewards import Transition as Transition
    from rans.tasks.rewards import is_used as is_used
    from rans.tasks.rewards import nearness as nearness
    from rans.tasks.rewards import speed as speed
    from rans.tasks.shapes import Ball as Ball
    from rans.tasks.shapes import Cone as Cone
    from rans.tasks.shapes import Shape as Shape
    from rans.tasks.shapes import SpeedLimit as SpeedLimit

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
