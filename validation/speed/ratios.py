"""What says more than a figure alone: ours against the machine's bound, and against others' beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rans.fast.learn.recipes import preset
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose
from validation.peers.runner import PEERS, PeerResult, measure_peer
from validation.speed.engine import engine_rate
from validation.speed.measurement import Measurement
from validation.speed.suite import Effort
from validation.speed.training import Success, train_until_solved, trainer_rate

_CRAFTS = ("floating-platform", "free-flyer")


@dataclass(frozen=True)
class Ratio:
    """Two figures of one machine, divided: medians of their repeats, or of one training each."""

    name: str
    value: float
    note: str = ""
    """What was divided, what is aimed at, and what does not compare."""


def bounds(measured: Sequence[Measurement]) -> Iterator[Ratio]:
    """Every figure that has a bound, as a share of it."""
    for m in measured:
        if m.value is not None and m.bound is not None:
            yield Ratio(
                f"{m.name}: share of {m.bound_name}",
                m.value / m.bound,
                f"{m.value:,.4g} of {m.bound:,.4g} {m.unit}",
            )


def compare_peers(
    spend: Effort,
    folder: Path,
    quick: bool,
    progress: Callable[[str], object],
) -> Iterator[tuple[PeerResult, list[Ratio]]]:
    """Measure every peer, and ours right after it.

    Args:
        spend: of ours.
        folder: of the peers' environments.
        quick: as little as possible of theirs; nobody trains until solved.
        progress: told who is measured.
    """
    for peer in PEERS:
        progress(peer.package)
        result = measure_peer(peer, spend.clock.device, folder, quick)
        yield result, list(_ratios(result, spend))


def _ratios(peer: PeerResult, spend: Effort) -> Iterator[Ratio]:
    """None for a peer that failed, or that ran elsewhere: JAX falls back to a CPU silently."""
    theirs = peer.figures
    device = spend.clock.device
    if theirs.get("device") != device.partition(":")[0]:
        return
    if "steps_per_s" in theirs:
        yield from _over_simulator(peer, spend)
    if "trained_steps_per_s" in theirs:
        settings = preset("go-to-pose", 2, device)
        ours = trainer_rate(load_spacecraft(_CRAFTS[0]), GoToPose(), settings, spend.clock)
        yield over_trainer(peer, _per_second(ours), device)
        if "seconds_to_success" in theirs:
            yield until_solved(peer, train_until_solved(settings, device))


def over_trainer(peer: PeerResult, rate: float, device: str) -> Ratio:
    """Trained steps/s of ours over a peer's, with the same network and batches."""
    theirs = peer.figures["trained_steps_per_s"]
    alike = (
        f"same task, network and settings; aimed at: {100 if device.startswith('cuda') else 5} or more"
        if peer.figures.get("same_task")
        else f"same network and batches; theirs learns another task: {peer.figures['task']}"
    )
    return Ratio(
        f"trained steps/s, over {peer.package}",
        rate / theirs,
        f"{rate:,.4g} over {theirs:,.4g}, medians; {alike}",
    )


def until_solved(peer: PeerResult, ours: Success) -> Ratio:
    """Seconds of training of a peer over ours, until the same judge finds the same task solved."""
    theirs = peer.figures
    unsolved = "" if theirs["solved"] else "; theirs did not solve it: the ratio is a lower bound"
    seconds = theirs["seconds_to_success"]
    return Ratio(
        f"seconds until solved, of {peer.package} over ours",
        seconds / ours.seconds,
        f"{seconds:.1f} s of {theirs['steps_to_success']:,} steps over {ours.seconds:.1f} s of "
        f"{ours.steps:,}; one training each{unsolved}",
    )


def _over_simulator(peer: PeerResult, spend: Effort) -> Iterator[Ratio]:
    """Environment steps/s of ours over a peer's, on that task of theirs which is nearest."""
    num_envs = peer.figures["num_envs"]
    theirs = peer.figures["steps_per_s"]
    for name in _CRAFTS:
        ours = engine_rate(
            load_spacecraft(name), GoToPose(), num_envs, spend.clock, compiled=spend.compiled
        )
        rate = _per_second(ours)
        yield Ratio(
            f"environment steps/s, {name} over {peer.package}",
            rate / theirs,
            f"{rate:,.4g} over {theirs:,.4g}, medians; {num_envs:,} environments; theirs flies "
            f"another task: {peer.figures['task']}",
        )


def _per_second(measured: Measurement) -> float:
    assert measured.value is not None  # only what needs a missing package is None
    return 1e6 * measured.value
