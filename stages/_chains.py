"""What `chain_recoveries` asks of learning, and who is run_teller of it while it goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml  # type: ignore[import-untyped]

from p2l.chaining.checkpoint import is_finished, refuse_others
from p2l.chaining.comparison import ChainRun, Observer, OpenObserver, RunKey
from p2l.chaining.mdp import Limits
from p2l.chaining.ppo import PPOSettings
from p2l.chaining.record import RunResult
from p2l.chaining.train import TrainSettings
from p2l.errors import ArtifactError
from p2l.schema import ChainRecoveriesConfig
from p2l.tracking import Tracker
from stages._child import child
from stages._progress import say, training

CONFIG = "config.yaml"  # what every stage leaves of its configuration
SAME, TOLD = ("tracking", "records"), 5  # sections that change no result; differences that a message names
NOTHING = "nothing that it tried while it learnt ended in success; a larger budget may help"


def chain_run(cfg: ChainRecoveriesConfig, name: str | None = None, seed: int | None = None) -> ChainRun:
    """One run: that of `learner`, or of one of those that are compared."""
    one = cfg.alone(name, seed)
    ppo = PPOSettings(**one.ppo_of(one.learner).model_dump())
    budget, every = round(one.budget * one.learner.budget_share), one.learner.evaluate_every or one.evaluation.every
    return ChainRun(
        item=one.item,
        name=name or one.learner.title,
        learner=one.learner.key,
        params=one.learner.params,
        seed=one.seed,
        config_hash=one.hash,
        settings=TrainSettings(budget, one.slots, every, one.evaluation.episodes, ppo, one.revisit),
        limits=Limits(**one.limits.model_dump()),
        narrowest=one.narrowest,
        nthread=one.world.params.get("nthread"),
    )


def hashes(cfg: ChainRecoveriesConfig) -> dict[RunKey, str]:
    """Of the configuration of each run that is compared."""
    return {(name, seed): chain_run(cfg, name, seed).config_hash for seed in cfg.seeds for name in cfg.compare}


def is_done(cfg: ChainRecoveriesConfig, out: Path) -> bool:
    """Whether this single run has finished in `out`.

    Raises:
        ArtifactError: there are policies that the run, or the comparison, would overwrite.
    """
    try:
        refuse_others(out, hashes(cfg))
        return not cfg.compare and is_finished(out, cfg.alone().hash)
    except ArtifactError as error:
        raise ArtifactError(f"{error}{_changed(cfg, out)}") from error


def _changed(cfg: ChainRecoveriesConfig, out: Path) -> str:
    """In what a finished run in `out` differs from this one, as a sentence; nothing where it left no configuration."""
    try:
        there = _flat(yaml.safe_load((out / CONFIG).read_text(encoding="utf-8")))
    except (OSError, ValueError, yaml.YAMLError):
        return ""
    here = _flat(cfg.model_dump(mode="json"))
    names = [name for name in {**there, **here} if there.get(name) != here.get(name) and name.split(".")[0] not in SAME]
    told = [f"{name} ({there.get(name, 'none')} there, {here.get(name, 'none')} here)" for name in names]
    rest = f" and {len(told) - TOLD} more" if len(told) > TOLD else ""
    return f". What differs: {', '.join(told[:TOLD])}{rest}" if told else ""


def _flat(section: Any, prefix: str = "") -> dict[str, Any]:
    """Values by dotted key."""
    if not isinstance(section, dict) or not section:
        return {prefix: section}
    parts = (_flat(value, f"{prefix}.{key}" if prefix else str(key)) for key, value in section.items())
    return {key: value for part in parts for key, value in part.items()}


@dataclass(frozen=True)
class _RunObserver:
    """Tells the tracker and the progress bar."""

    track: Tracker
    show: Callable[[int, float | None], None]
    title: str

    def row(self, kind: str, row: Mapping[str, float]) -> None:
        """See `Observer`."""
        steps = int(row["control_steps"])
        charged = steps + int(row["spared"])
        if kind == "resumed":
            self.show(charged, None)
            return
        numbers = {name.replace("+", "plus "): value for name, value in row.items() if name != "control_steps"}
        self.track.metrics({f"{kind}/{name}": value for name, value in numbers.items()}, step=steps)
        if kind == "round":
            self.show(charged, row["done"] / max(row["ended"], 1))
        else:
            say(f"{self.title}: {charged:,} steps, the policy succeeds in {evaluated(row)}")

    def note(self, text: str) -> None:
        """See `Observer`."""
        self.track.note(text)


def evaluated(row: Mapping[str, float]) -> str:
    """An evaluation in words: success in the task's world, and in each of a mixture's."""
    there = {name.partition(":")[2]: value for name, value in row.items() if name.startswith("success:")}
    worlds = f" of its own world; {_worlds(there)}; {row['success_everywhere']:.0%} of all episodes" if there else ""
    return f"{row['success']:.0%} of {row['episodes']:.0f} episodes{worlds}"


def _worlds(success: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.0%}" for name, value in success.items())


def run_observer(cfg: ChainRecoveriesConfig, track: Tracker, *, alone: bool = False) -> OpenObserver:
    """Opens a run's progress bar and, for each of those that are compared, its child run."""

    @contextmanager
    def observer(one: ChainRun, folder: Path) -> Iterator[Observer]:
        mine = nullcontext(track) if alone else child(track, cfg, "chain_recoveries", one.name, one.seed, folder)
        title = f"{cfg.item} {one.name} s{one.seed}"
        with mine as tracker, training(title, one.settings.budget) as show:
            yield _RunObserver(tracker, show, title)

    return observer


def run_teller(track: Tracker) -> Callable[[RunKey, RunResult], None]:
    """Tells the tracker what came out of each run."""

    def tell(key: RunKey, learnt: RunResult) -> None:
        if not learnt.times:
            print(f"{key[0]} s{key[1]}: in the records already")
        elif not learnt.rounds["done"].any():
            print(f"{key[0]} s{key[1]}: {NOTHING}")
        numbers = {name: value for name, value in {**learnt.facts, **learnt.times}.items() if value is not None}
        track.metrics({f"{key[0]}/s{key[1]}/{name}": value for name, value in numbers.items()})

    return tell


def closing_line(learnt: RunResult) -> str:
    """What a person is told of a run that has ended."""
    best, last = (learnt.facts[f"{which}_evaluation"] for which in ("best", "last"))
    where = ", in all worlds that it practised in" if "success_everywhere" in learnt.evaluations else ""
    return (
        f"the policy that is kept succeeded in {best:.0%} of its evaluation's episodes{where}, the best of "
        f"{len(learnt.evaluations)} evaluations (the last: {last:.0%})"
    ) + ("" if learnt.rounds["done"].any() else f"; {NOTHING}")
