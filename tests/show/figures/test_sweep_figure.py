from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.colors import to_hex

from rans.fast.learn.config import TrainConfig
from rans.fast.learn.sweep import Member, Sweep
from rans.show.figures.sweep_figure import sweep_figure
from rans.show.palette import ORANGE
from tests.support.training import CONFIG, TINY


def sweep() -> Sweep:
    """Two seeds of two step sizes; the first seed of the second is the best, and one never solves it."""
    configs = [
        replace(CONFIG, seed=seed, solved_share=0.9, ppo=replace(TINY, learning_rate=rate))
        for rate in (1e-3, 3e-4)
        for seed in (0, 1)
    ]
    result = Sweep(configs, Path("nowhere"))
    ends = zip(configs, (500, 400, 200, 300), (0.5, 1.0, 1.0, 1.0), strict=True)
    result.members = [member(config, steps, success) for config, steps, success in ends]
    return result


def member(config: TrainConfig, steps: int, success: float) -> Member:
    rows = [
        {"steps": when, "success": success, "train/learning_rate": 1e-3}
        for when in (steps - 100, steps)
    ]
    return Member(
        replace(
            config, report_interval=1, ppo=replace(config.ppo, n_envs=2, n_steps=1, batch_size=2)
        ),
        rows,
        has_agent=True,
    )


def test_every_member_has_a_curve_and_a_mark_and_the_best_stands_out() -> None:
    curves, ends = sweep_figure(sweep()).axes
    assert [list(line.get_xdata()) for line in curves.get_lines()[:4]] == [  # type: ignore[arg-type]
        [400, 500],
        [300, 400],
        [100, 200],
        [200, 300],
    ]
    best = curves.get_lines()[4]
    assert (to_hex(best.get_color()), best.get_label()) == (ORANGE.lower(), "best: seed 0")
    assert list(best.get_xdata()) == [100, 200]  # type: ignore[arg-type]
    marks = [
        (float(dot.get_offsets()[0][0]), to_hex(dot.get_facecolor()[0]))  # type: ignore
        for dot in ends.collections
    ]
    assert [x for x, _ in marks] == [500, 400, 200, 300]
    assert [colour == ORANGE.lower() for _, colour in marks] == [False, False, True, False]
    # a cross has four ends, a disc many points: the first never solved it
    crosses = [np.asarray(dot.get_paths()[0].vertices).shape == (4, 2) for dot in ends.collections]
    assert crosses == [True, False, False, False]
    names = [text.get_text() for text in ends.get_yticklabels()]
    assert names == ["learning_rate 0.001", "learning_rate 0.0003"]
    assert [list(line.get_ydata()) for line in curves.get_lines()[:2]] == [  # type: ignore[arg-type]
        [50.0, 50.0],
        [100.0, 100.0],
    ]
