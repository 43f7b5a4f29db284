"""Opens what chapter 4's stages work on: the world with its preconditions, failures and their modes."""

from __future__ import annotations

import logging
from pathlib import Path

from p2l.evaluation.video.failures import skip
from p2l.evaluation.video.player import VideoOptions
from p2l.evaluation.video.recoveries import film_recoveries
from p2l.failures.classifier import load_modes
from p2l.failures.record import check_pair, check_params, load_failures, open_world
from p2l.metareskill.learn import Rewards, Setting, members, start_graph
from p2l.metareskill.query import QueryOptions
from p2l.metareskill.record import Recoveries
from p2l.metareskill.target import Task
from p2l.preconditions.record import load_preconditions
from p2l.registry import get_symbols
from p2l.schema import LearnRecoveriesConfig
from p2l.skills.relative import Timing

log = logging.getLogger(__name__)


def open_setting(cfg: LearnRecoveriesConfig) -> Setting:
    """Read and check every input; nothing is computed before all of them fit together."""
    train, held_out = load_failures(cfg.failures, "train"), load_failures(cfg.held_out, "held_out")
    check_params(train, cfg.world.name, cfg.world.params, cfg.failures)
    check_pair(train, held_out, cfg.held_out)
    world, _ = open_world(train, cfg.failures)
    modes = load_modes(cfg.modes, world)
    preconditions = load_preconditions(cfg.preconditions, world)
    task = Task(world, get_symbols(world.name, world), preconditions)
    failures, dropped = members(task, train, modes)
    tests, dropped_tests = members(task, held_out, modes)
    if dropped + dropped_tests:
        log.info("left out, since a learnt precondition holds: %d and %d held-out failures", dropped, dropped_tests)
    graph = start_graph(task, failures, modes, Rewards(**cfg.rewards.model_dump()))
    options = QueryOptions(**cfg.query.model_dump(), timing=Timing(**cfg.timing.model_dump()))
    return Setting(task, modes, failures, tests, graph, options, cfg.trials, cfg.regression == "residual")


def film(cfg: LearnRecoveriesConfig, setting: Setting, learnt: Recoveries, folder: Path) -> list[Path]:
    """Film each mode before and after, if that is wanted; the files."""
    if cfg.videos:
        held_out = load_failures(cfg.held_out, "held_out")
        film_recoveries(folder, setting, held_out, learnt, VideoOptions(**cfg.video.model_dump()))
    else:
        skip(folder, "videos=false")
    return sorted(folder.glob("*.mp4"))
