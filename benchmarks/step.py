"""What a cheaper physics step would give, and what it would change: the same episodes, run with each.

  python -m benchmarks.step                                  every world of chapters 4 and 5, 1000 episodes each, seed 0
  python -m benchmarks.step --worlds shelf --episodes 200 --variants pyramidal "5 iterations"

Each variant differs from the world in one thing. `same_percent` of the episodes end alike: success, or the same kind of
failure, row by row; `nudged` is the reference itself from states in which the first joint is turned by a billionth of a
radian, which says how much of a difference is chance. `speed` is the reference's time by the variant's, measured in
turn with it; `steps` tells what of that comes from episodes that end earlier. A variant is worth having where it is
faster and at least 97 % end alike.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from benchmarks import report
from benchmarks.nominal import OPEN_LOOP, first_flags
from p2l.contracts.rows import Rows
from p2l.contracts.world import Scenic
from p2l.evaluation.statistics import wilson_interval
from p2l.records import IntArray
from p2l.skills import chain
from p2l.worlds.table import make_world

WORLDS = ("door", "pick_place", "shelf", "cluttered_shelf")
SUCCESS = -2  # beside the kinds of failures, and none
NUDGE_RAD = 1e-9
ARM_BODY = re.compile(r"robot\d+_link\d+")


def without_arm_contacts(model: mujoco.MjModel) -> None:
    """The links of the arm touch nothing; hand and fingers do."""
    for geom in range(model.ngeom):
        if ARM_BODY.fullmatch(model.body(model.geom_bodyid[geom]).name):
            model.geom_contype[geom] = model.geom_conaffinity[geom] = 0


def without_warm_start(model: mujoco.MjModel) -> None:
    """The solver begins anew in every step."""
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_WARMSTART)


def _option(**values: Any) -> Callable[[mujoco.MjModel], None]:
    def change(model: mujoco.MjModel) -> None:
        for name, value in values.items():
            setattr(model.opt, name, value)

    return change


CHANGES: Mapping[str, Callable[[mujoco.MjModel], None]] = {
    "20 iterations": _option(iterations=20),
    "5 iterations": _option(iterations=5),
    "tolerance 1e-6": _option(tolerance=1e-6),
    "tolerance 1e-4": _option(tolerance=1e-4),
    "5 line searches": _option(ls_iterations=5),
    "conjugate gradient": _option(solver=mujoco.mjtSolver.mjSOL_CG),
    "pyramidal": _option(cone=mujoco.mjtCone.mjCONE_PYRAMIDAL),
    "Euler": _option(integrator=mujoco.mjtIntegrator.mjINT_EULER),
    "no warm start": without_warm_start,
    "arm touches nothing": without_arm_contacts,
}
STEPS = {"step × 1.5": 1.5, "step × 2": 2.0}
VARIANTS = ("nudged", *CHANGES, *STEPS)


def _outcomes(world: Scenic, rows: Rows, *, stop: bool) -> tuple[IntArray, float, float]:
    """[N] how each episode ended, its mean control steps, and the seconds of all."""
    start = time.perf_counter()
    execution = chain.run(world, world.nominal_options(), rows, stop_on_failure=stop, slots=128)
    seconds = time.perf_counter() - start
    return np.where(execution.success, SUCCESS, first_flags(execution)), float(execution.last.step.mean()), seconds


def _variant(name: str, variant: str, rows: Rows) -> tuple[Scenic, Rows] | None:
    """The world and the rows of a variant; None where its time step does not divide a control step."""
    if variant == "nudged":
        states = rows.states.copy()
        states[:, 1] += NUDGE_RAD
        return make_world(name, {}), replace(rows, states=states)
    if variant in CHANGES:
        world = make_world(name, {})
        for model in world.engine.models:
            CHANGES[variant](model)
        return world, rows
    reference = make_world(name, {}).engine
    steps = reference.physics_steps / STEPS[variant]
    if abs(steps - round(steps)) > 1e-9:
        return None
    return make_world(name, {"timestep_s": reference.timestep_s * STEPS[variant]}), rows


def compare(name: str, variants: list[str], episodes: int, seed: int) -> list[report.Row]:
    """A row for each variant of a world, beside the world itself."""
    world = make_world(name, {})
    rows, stop = world.sample(np.random.default_rng(seed), episodes), name not in OPEN_LOOP
    _outcomes(world, rows.take(np.arange(min(episodes, 32))), stop=stop)  # threads and caches are warm
    table: list[report.Row] = []
    for variant in variants:
        made = _variant(name, variant, rows)
        if made is None:
            continue
        reference, steps, reference_s = _outcomes(world, rows, stop=stop)
        other, other_steps, seconds = _outcomes(*made, stop=stop)
        same = reference == other
        low, high = wilson_interval(same.sum(), len(same))
        table.append(
            {
                "world": name,
                "variant": variant,
                "episodes": episodes,
                "same_percent": round(100.0 * same.mean(), 1),
                "low": round(100.0 * float(low), 1),
                "high": round(100.0 * float(high), 1),
                "success_percent": round(100.0 * (other == SUCCESS).mean(), 1),
                "reference_percent": round(100.0 * (reference == SUCCESS).mean(), 1),
                "steps": round(other_steps / steps, 3),
                "speed": round(reference_s / seconds, 2),
            }
        )
        print(f"{name}: {variant} done")
    return table


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = report.parser(__doc__)
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=list(WORLDS))
    parser.add_argument("--variants", nargs="+", choices=VARIANTS, default=list(VARIANTS))
    parser.add_argument("--episodes", type=report.positive, default=1000)
    parser.add_argument("--seed", type=report.seed, default=0)
    args = parser.parse_args(arguments)
    tables = [compare(name, args.variants, args.episodes, args.seed) for name in args.worlds]
    report.finish([row for table in tables for row in table], args.json)


if __name__ == "__main__":
    report.command(main)
