"""Facility location: public instances proven to their optima, and harder families made up like the literature's.

python -m benchmarks.ufl                            OR-Library instances of data/ufl
python -m benchmarks.ufl --instances FOLDER FILE    other OR-Library or UflLib files
python -m benchmarks.ufl --families                 generated: warehouses, k-median, M*, Koerkel-Ghosh
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks import instances, report
from p2l.records import Array
from p2l.team import solve_facility_location
from p2l.team.facility import read_instance

_DEFAULT = Path(__file__).resolve().parent.parent / "data" / "ufl"
Instance = tuple[str, Array, Array, float | None]


def files(places: list[Path]) -> Iterator[Instance]:
    """Instances of folders and files, with the optimum that an `optima.csv` beside them gives."""
    for place in places:
        for path in sorted(place.glob("*.txt")) if place.is_dir() else [place]:
            opening, service = read_instance(path)
            yield path.stem, opening, service, _optima(path.parent).get(path.stem)


def _optima(folder: Path) -> dict[str, float]:
    table = folder / "optima.csv"
    if not table.is_file():
        return {}
    with table.open(encoding="utf-8", newline="") as stream:
        return {row["instance"]: float(row["optimum"]) for row in csv.DictReader(stream)}


def families(rng: np.random.Generator) -> Iterator[Instance]:
    """Generated instances of the literature's families; the dense Koerkel-Ghosh ones have large gaps."""
    for count in (100, 300):
        yield f"warehouses {count}x1000", *instances.warehouses(count, 1000, rng), None
    for size, divisor in ((500, 10.0), (1000, 100.0), (1000, 1000.0)):
        yield f"k-median {size} /{divisor:g}", *instances.euclidean(size, rng, divisor), None
    for size in (100, 200, 300, 500):
        yield f"M* {size}", *instances.many_optima(size, rng), None
    for kind in "abc":
        for size in (100, 250):
            yield f"Koerkel-Ghosh {kind} {size}", *instances.dense(size, kind, rng), None


def measure(source: Iterator[Instance], time_limit_s: float) -> list[report.Row]:
    """Solve every instance to optimality and compare with the known optimum."""
    rows: list[report.Row] = []
    for name, opening, service, optimum in source:
        solution = solve_facility_location(opening, service, time_limit_s=time_limit_s, gap=0.0)
        rows.append(
            {
                "instance": name,
                "facilities": len(opening),
                "demands": len(service),
                "cost": solution.cost,
                "bound": solution.lower_bound,
                "gap_percent": 100.0 * solution.gap,
                "status": solution.status,
                "seconds": round(solution.seconds, 4),
                "off_optimum": None if optimum is None else solution.cost / optimum - 1.0,
            }
        )
    return rows


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = report.parser(__doc__)
    parser.add_argument("--instances", type=Path, nargs="+", default=[_DEFAULT], help="files or folders")
    parser.add_argument("--families", action="store_true", help="generated families instead of files")
    parser.add_argument("--time-limit", type=float, default=60.0, metavar="S", help="seconds per instance")
    parser.add_argument("--seed", type=report.seed, default=0)
    args: argparse.Namespace = parser.parse_args(arguments)
    report.load_kernels()
    source = families(np.random.default_rng(args.seed)) if args.families else files(args.instances)
    report.finish(measure(source, args.time_limit), args.json)


if __name__ == "__main__":
    report.command(main)
