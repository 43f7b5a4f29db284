"""Where strategies are compared: the training world, other doors, and robosuite's own door (thesis, section 4.4).

Preconditions stay as they were learnt.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from p2l.contracts.world import symbols_of
from p2l.metareskill.episodes import Place
from p2l.metareskill.strategy_names import OPEN_LOOP, RECOVERIES
from p2l.metareskill.target import RecoveryTask
from p2l.preconditions.record import Preconditions
from p2l.worlds.table import make_world

ESTIMATOR, IDEAL_ESTIMATOR = "halving", "after_first"  # thesis, section 4.4.1: in simulation; on a real robot
LEVERS = ("1", "2", "3", "4", "5")  # the full-sized door stands apart, in the thesis too
PAIR = (RECOVERIES, OPEN_LOOP)
Visit = tuple[Place, Sequence[str], Sequence[int]]  # a place, the strategies and the seeds that go there


@dataclass(frozen=True)
class Tour:
    """Strategies, and the places in which they are compared.

    Attributes:
        item: the training world, or a variant of it.
        world: name or target of it.
        params: of it.
        strategies: in the training world; elsewhere learnt recoveries and the open loop.
        seeds: of learning.
        episodes: in the training world, for each strategy and seed.
        slots: episodes at once.
        handles: other doors.
        handle_episodes: on each of them.
        robosuite_seeds: of learning, in robosuite; none: left out.
        robosuite_episodes: there.
    """

    item: str
    world: str
    params: Mapping[str, Any]
    strategies: Sequence[str]
    seeds: Sequence[int]
    episodes: int
    slots: int
    handles: Sequence[str]
    handle_episodes: int
    robosuite_seeds: Sequence[int]
    robosuite_episodes: int

    @property
    def unseen(self) -> list[str]:
        """Settings of the levers that recoveries were not trained on."""
        own = str(self.params.get("handle", LEVERS[0]))
        return [f"handle={handle}" for handle in self.handles if handle in LEVERS and handle != own]


def places(tour: Tour, preconditions: Preconditions, stack: ExitStack) -> list[Visit]:
    """Every place with the strategies and seeds that go there; `stack` closes robosuite's environment."""
    visits: list[Visit] = [
        (_place(tour, preconditions, tour.item, "", tour.episodes, ESTIMATOR), tour.strategies, tour.seeds)
    ]
    for handle in tour.handles:
        name, setting = f"{tour.item}_handle_{handle}", f"handle={handle}"
        other = _place(tour, preconditions, name, setting, tour.handle_episodes, IDEAL_ESTIMATOR, handle)
        visits.append((other, PAIR, tour.seeds))
    if tour.robosuite_seeds:
        name, setting = f"{tour.item}_robosuite", "simulator=robosuite"
        own = _place(tour, preconditions, name, setting, tour.robosuite_episodes, IDEAL_ESTIMATOR)
        visits.append((_in_robosuite(own, stack), PAIR, tour.robosuite_seeds))
    return visits


def _place(
    tour: Tour,
    preconditions: Preconditions,
    name: str,
    setting: str,
    episodes: int,
    estimator: str,
    handle: str | None = None,
) -> Place:
    """The world with another estimator and, if given, another handle."""
    params = {**tour.params, "estimator": estimator} | ({} if handle is None else {"handle": handle})
    world = make_world(tour.world, params)
    task = RecoveryTask(world, symbols_of(world), preconditions)
    return Place(name, setting, world, task, world.nominal_options(), episodes, tour.slots)


def _in_robosuite(own: Place, stack: ExitStack) -> Place:
    """The same place, simulated, controlled and judged by robosuite, one row at a time."""
    from p2l.worlds.robosuite import make

    transfer = make(own.world)
    stack.callback(transfer.engine.close)
    task = RecoveryTask(transfer, own.task.symbols, own.task.preconditions)
    return Place(own.name, own.setting, own.world, task, own.nominal, own.episodes, 1)
