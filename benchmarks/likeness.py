"""How alike our pick-place hand moves to robosuite's: the same failures, one primitive from each, in both.

  python -m benchmarks.likeness                            the task's world and each of its mixture, 24 failures, seed 0
  python -m benchmarks.likeness --worlds plain osc --failures 12

The failures are robosuite's, under OSC_POSE; a row of the table is a world of ours that they are put into. In
`same_percent` of the motions both agree on whether a detector fires again (after it has been silent), with Wilson's
95 % interval; `off_mm` is how far apart the hands are on the way, root mean square, and `off_deg` how differently they
are turned at the end. A policy that is to work in robosuite should practise where both are alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import OmegaConf
from tqdm import tqdm

from benchmarks import report
from p2l import poses
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.errors import ConfigError
from p2l.evaluation.statistics import wilson_interval
from p2l.records import Array, BoolArray
from p2l.skills import chain
from p2l.skills.primitives import STEPS
from p2l.skills.runner import Reason
from p2l.worlds import robosuite as robosuite_sim
from p2l.worlds.table import make_world

PRESET = Path(__file__).parents[1] / "conf" / "chaining" / "pick_place.yaml"
PLAIN = "plain"  # the task's own world
TRIED = ("turn +z", "turn -z", "move +x", "move -y", "move -z")
MOST = 20  # executions for each failure


def mixture() -> Mapping[str, Mapping[str, Any]]:
    """The worlds that `search_mixed` practises in, by name, and the task's own."""
    others: Any = OmegaConf.to_container(OmegaConf.load(PRESET).learners.search_mixed.params.mixture)
    return {PLAIN: {}, **others}


def robosuite_failures(there: robosuite_sim.TransferWorld, count: int, seed: int) -> list[Rows]:
    """Moments at which a detector has fired in robosuite, a row each.

    Raises:
        ConfigError: there are none.
    """
    rng, found = np.random.default_rng(seed), []
    for _ in range(MOST * count):
        part = chain.run(there, there.nominal_options(), there.sample(rng, 1), slots=1).last
        if part.reason[0] == Reason.FAILURE:
            found.append(part.rows)
        if len(found) == count:
            break
    if not found:
        raise ConfigError(
            f"the nominal skills raised no flag in {MOST * count} executions in robosuite; take another --seed"
        )
    return found


def motion(world: World, option: Option, rows: Rows) -> tuple[Array, Array, BoolArray]:
    """[T, N, 3] where the hand is, m, [N, 4] how it is turned at the end, and [N] whether a detector fired again."""
    memory, silent = option.begin(world.observe(rows)), np.zeros(len(rows), dtype=np.bool_)
    again, path = silent.copy(), []
    for step in range(STEPS):
        decision = option.decide(world.observe(rows), memory, np.full(len(rows), step))
        rows, kind, _ = world.advance(rows, decision.command)
        again |= silent & (kind >= 0)
        silent |= kind < 0
        path.append(world.observe(rows)["grip_pos_m"])
    return np.array(path), world.observe(rows)["grip_quat"], again


def likeness(world: World, failures: Rows, there: Mapping[str, tuple[Array, Array, BoolArray]]) -> dict[str, float]:
    """The numbers of one world beside the motions `there`, by primitive."""
    same, off_m, off_rad = [], [], []
    for option in world.primitives():
        if option.name in there:
            path, quat, again = motion(world, option, failures)
            other_path, other_quat, other_again = there[option.name]
            same.append(again == other_again)
            off_m.append(np.linalg.norm(path - other_path, axis=2))
            off_rad.append(poses.angle(quat, other_quat))
    agree = np.concatenate(same)
    low, high = wilson_interval(int(agree.sum()), len(agree))
    return {
        "same_percent": round(100.0 * float(agree.mean()), 1),
        "low": round(100.0 * float(low), 1),
        "high": round(100.0 * float(high), 1),
        "off_mm": round(1000.0 * float(np.sqrt(np.mean(np.square(off_m)))), 1),
        "off_deg": round(float(np.degrees(np.mean(off_rad))), 1),
    }


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    worlds = mixture()
    parser = report.parser(__doc__)
    parser.add_argument("--worlds", nargs="+", choices=list(worlds), default=list(worlds))
    parser.add_argument("--failures", type=report.positive, default=24)
    parser.add_argument("--seed", type=report.seed, default=0)
    args = parser.parse_args(arguments)
    there = robosuite_sim.make(make_world("pick_place", {"nthread": 1}))
    try:
        found = robosuite_failures(there, args.failures, args.seed)
        options = [option for option in there.primitives() if option.name in TRIED]
        motions = {}
        for option in tqdm(options, desc="primitives in robosuite"):
            paths, quats, again = zip(*(motion(there, option, row) for row in found), strict=True)
            motions[option.name] = np.concatenate(paths, axis=1), np.concatenate(quats), np.concatenate(again)
        each = [there.original(row).arrays() for row in found]
        failures = Rows.from_arrays({name: np.concatenate([row[name] for row in each]) for name in each[0]})
    finally:
        there.engine.close()
    rows = []
    for name in args.worlds:
        world = make_world("pick_place", {"nthread": 1, **worlds[name]})
        rows.append({"world": name, "failures": len(failures), **likeness(world, failures, motions)})
    report.finish(rows, args.json)


if __name__ == "__main__":
    report.command(main)
