"""Episodes with the recoveries in place: where failure rounds see success, and what is left to fail.

Axis letters: K nominal skills, N episodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.metareskill.record import Recoveries
from p2l.metareskill.setting import Setting
from p2l.metareskill.strategies import playbook
from p2l.metareskill.target import RecoveryTask
from p2l.skills.chain import Execution, run


@dataclass(frozen=True)
class Field:
    """Where episodes are run.

    Attributes:
        task: its world's estimator halves its error.
        nominal: K options.
        max_options: of an episode.
        slots: episodes at once.
    """

    task: RecoveryTask
    nominal: tuple[Option, ...]
    max_options: int
    slots: int


def execute(
    field: Field, strategy: str, starts: Rows, setting: Setting, recoveries: Recoveries | None, rng: np.random.Generator
) -> Execution:
    """Run one episode from each of `starts` [N]; strategy `recoveries` needs its skills."""
    policy = playbook(
        strategy,
        field.task,
        field.nominal,
        setting.graph if recoveries is None else recoveries.graph,
        setting.options.timing,
        rng,
        modes=setting.modes,
        skills=None if recoveries is None else recoveries.skills,
        max_options=field.max_options,
    )
    return run(field.task.world, policy.options, starts, choose=policy.choose, stop_on_failure=False, slots=field.slots)
