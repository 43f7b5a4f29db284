"""What chapter 4's stages work on, out of their configuration."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from p2l.evaluation.video.failures import skip
from p2l.evaluation.video.player import VideoOptions
from p2l.evaluation.video.recoveries import film_recoveries
from p2l.metareskill.clips import mode_clips
from p2l.metareskill.history import History
from p2l.metareskill.inputs import Files, Inputs, open_inputs
from p2l.metareskill.query import QueryOptions
from p2l.metareskill.record import Recoveries
from p2l.metareskill.setting import Rewards
from p2l.schema import LearnRecoveriesConfig
from p2l.skills.relative import Timing
from p2l.tracking import Tracker


def inputs_of(cfg: LearnRecoveriesConfig, out: Path) -> Inputs:
    """Read and check every input, and measure where recoveries begin; `out` has the record where no folder is named."""
    files = Files(cfg.failures, cfg.held_out, cfg.modes, cfg.preconditions)
    options = QueryOptions(**cfg.query.model_dump(), timing=Timing(**cfg.timing.model_dump()))
    rewards = Rewards(**cfg.rewards.model_dump())
    return open_inputs(
        files,
        cfg.world.key,
        cfg.world.params,
        rewards,
        options,
        cfg.trials,
        guesses=cfg.guesses,
        records=cfg.records or out / "records",
        item=cfg.item,
    )


def round_teller(track: Tracker, show: Callable[[int], None]) -> Callable[[History], None]:
    """Tells of every round of training."""

    def report(history: History) -> None:
        last = history.rounds[-1]
        numbers = {"value": last.value, "predicted": last.predicted, "q_upper": last.q_upper, "q": last.q}
        track.metrics({**numbers, "mode": last.mode, "target": last.target, "solved": last.solved}, step=len(history))
        show(1)

    return report


def film(cfg: LearnRecoveriesConfig, inputs: Inputs, learnt: Recoveries, folder: Path) -> list[Path]:
    """Film each mode before and after, if that is wanted; the files."""
    if cfg.videos:
        clips = mode_clips(inputs.setting, inputs.held_out, learnt)
        film_recoveries(folder, inputs.setting.task.world, clips, VideoOptions(**cfg.video.model_dump()))
    else:
        skip(folder, "videos=false")
    return sorted(folder.glob("*.mp4"))
