"""Where `evaluate_recoveries` compares strategies: the training world, other doors, and robosuite's own door."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack

from p2l.metareskill.episodes import LEARNT, OPEN_LOOP, Place
from p2l.metareskill.target import Task
from p2l.preconditions.record import Preconditions
from p2l.registry import get_options, get_symbols, get_world
from p2l.schema import EvaluateRecoveriesConfig

IMPROVING, IDEALISED = "halving", "after_first"  # thesis, section 4.4.1: in simulation; on a real robot
LEVERS = ("1", "2", "3", "4", "5")  # the full-sized door stands apart, in the thesis too
PAIR = (LEARNT, OPEN_LOOP)
Visited = tuple[Place, Sequence[str], Sequence[int]]


def places(cfg: EvaluateRecoveriesConfig, preconditions: Preconditions, stack: ExitStack) -> list[Visited]:
    """Every place with the strategies and seeds that go there; `stack` closes robosuite's environment."""
    found: list[Visited] = [
        (place(cfg, preconditions, cfg.item, "", cfg.episodes, IMPROVING), cfg.strategies, cfg.seeds)
    ]
    for handle in cfg.handles:
        name, setting = f"{cfg.item}_handle_{handle}", f"handle={handle}"
        door = place(cfg, preconditions, name, setting, cfg.handle_episodes, IDEALISED, handle)
        found.append((door, PAIR, cfg.seeds))
    if cfg.robosuite_seeds:
        own = place(
            cfg, preconditions, f"{cfg.item}_robosuite", "simulator=robosuite", cfg.robosuite_episodes, IDEALISED
        )
        found.append((in_robosuite(own, stack), PAIR, cfg.robosuite_seeds))
    return found


def place(
    cfg: EvaluateRecoveriesConfig,
    preconditions: Preconditions,
    name: str,
    setting: str,
    episodes: int,
    estimator: str,
    handle: str | None = None,
) -> Place:
    """The configured world with another estimator and, if given, another handle; preconditions stay as learnt."""
    params = {**cfg.world.params, "estimator": estimator} | ({} if handle is None else {"handle": handle})
    world = get_world(cfg.world.name, params)
    task = Task(world, get_symbols(world.name, world), preconditions)
    return Place(name, setting, world, task, get_options(world.name, world), episodes, cfg.slots)


def in_robosuite(own: Place, stack: ExitStack) -> Place:
    """The same place, simulated, controlled and judged by robosuite, one row at a time."""
    from p2l.worlds.robosuite import make

    transfer = make(own.world)
    stack.callback(transfer.engine.close)
    task = Task(transfer, own.task.symbols, own.task.preconditions)
    return Place(own.name, own.setting, own.world, task, own.nominal, own.episodes, 1)


def unseen(cfg: EvaluateRecoveriesConfig) -> list[str]:
    """Settings of the levers that recoveries were not trained on."""
    trained = str(cfg.world.params.get("handle", LEVERS[0]))
    return [f"handle={handle}" for handle in cfg.handles if handle in LEVERS and handle != trained]
