"""Episodes that start at moments of earlier, successful episodes.

Where random decisions hardly ever succeed (in 0.7 % of the shelf's episodes), a rollout of 120 decisions seldom holds
a success, and PPO has little to learn from. The simulator restores any moment, as it restores the recorded failures; so
some episodes start in the middle of an earlier success, where little is left to do: its last decision is learnt first,
then the one before, back to the failure (as Florensa et al., 2017, and Salimans and Chen, 2018, learn backwards). Of a
way's moments, those that sometimes lead to success are preferred to those that always or never do.

One way is kept for each failure, the shortest success, and of the failures that have one, those whose recovery succeeds
least are revisited most often. Otherwise the failures that are easy to recover from, whose ways are many,
hide those that ask for several right decisions (half of the cluttered shelf's), and the policy repeats what is easy. A
failure that one decision recovers from is not revisited: nothing of that way is left to do.

Where the state is observed in part, a success at one failure is seldom one at others that look alike, and too many such
episodes teach luck. So their share grows with the failures that can be revisited, up to `MANY`, and falls with the
recent success from recorded failures, to 0 at `ENOUGH`.

1. The thesis starts every episode at a recorded failure. Here, too, only those count in a round's success, and
   evaluations start nowhere else. All simulated control steps count.

Axis letters: B slots, K decisions or episodes, O observation columns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.artifacts import part
from p2l.contracts.rows import Rows
from p2l.records import Array, BoolArray, IntArray
from p2l.seeding import generator_state, restore_generator

RECENT = 100  # episodes from recorded failures that the recent success is taken over
ENOUGH = 0.5  # recent success at which revisiting ends
MANY = 20  # failures with a way, from which on their number does not matter
FOLLOW = 0.3  # step of the running mean of success, of a failure or of a moment
SELDOM = (
    0.01  # weight of a failure that is always recovered from, and of a moment that always or never leads to success
)


@dataclass(frozen=True)
class RevisitMoments:
    """K moments before a decision.

    Attributes:
        rows: [K] the simulation.
        state: [K, O] the agent's.
        decisions: [K] decisions before.
        primitive_steps: [K] control steps in primitives before.
        muted: [K] the flag of the recorded failure is still up.
    """

    rows: Rows
    state: Array
    decisions: IntArray
    primitive_steps: IntArray
    muted: BoolArray

    def take(self, index: IntArray) -> RevisitMoments:
        """Those of `index`."""
        return RevisitMoments(
            rows=self.rows.take(index),
            state=self.state[index],
            decisions=self.decisions[index],
            primitive_steps=self.primitive_steps[index],
            muted=self.muted[index],
        )

    def put(self, index: IntArray, moments: RevisitMoments) -> None:
        """Overwrite those of `index`; only for the owner of these arrays."""
        self.rows.put(index, moments.rows)
        for name in ("state", "decisions", "primitive_steps", "muted"):
            getattr(self, name)[index] = getattr(moments, name)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """All by name, for a checkpoint."""
        rows = {f"rows.{name}": value for name, value in self.rows.arrays().items()}
        return rows | {name: getattr(self, name) for name in ("state", "decisions", "primitive_steps", "muted")}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> RevisitMoments:
        """From what `arrays` gave."""
        parts = {name: np.array(arrays[name]) for name in ("state", "decisions", "primitive_steps", "muted")}
        return cls(rows=Rows.from_arrays(part(arrays, "rows.")), **parts)

    @classmethod
    def join(cls, parts: Sequence[RevisitMoments]) -> RevisitMoments:
        """One after the other."""
        return cls(
            rows=Rows.join([part.rows for part in parts]),
            state=np.concatenate([part.state for part in parts]),
            decisions=np.concatenate([part.decisions for part in parts]),
            primitive_steps=np.concatenate([part.primitive_steps for part in parts]),
            muted=np.concatenate([part.muted for part in parts]),
        )


@dataclass
class _Way:
    """Moments of a successful episode, from its failure to its last decision, and the success of episodes from each."""

    moments: RevisitMoments
    success: Array

    def __len__(self) -> int:
        return len(self.success)


@dataclass
class _Failure:
    """A recorded failure: the running success of episodes from it, and its shortest way."""

    success: float = 0.0
    way: _Way | None = None


@dataclass
class _Episode:
    """The present episode of a slot.

    Attributes:
        failure: that it started at, or whose way it revisits; a blank one before the first decision.
        way: that it revisits; None: it started at the failure.
        moment: of the way, at which it started.
        last: number of its latest decision.
    """

    failure: _Failure = field(default_factory=_Failure)
    way: _Way | None = None
    moment: int = 0
    last: int = 0


class Revisits:
    """Moments of the present episodes, and the ways of the successful ones.

    Args:
        share: largest share of new episodes that start at an earlier success, in [0, 1].
        slots: B.
        decisions: most decisions of an episode.
        rng: draws those episodes, and their moments.
    """

    def __init__(self, share: float, slots: int, decisions: int, rng: np.random.Generator) -> None:
        self._share, self._decisions, self._rng = share, decisions, rng
        self._episodes = [_Episode() for _ in range(slots)]
        self._failures: dict[bytes, _Failure] = {}  # by their start state: what looks the same is the same
        self._recent = np.zeros(RECENT)
        self._fresh_count = 0  # episodes from recorded failures that have ended
        self._trace: RevisitMoments | None = None  # [B · decisions]

    @property
    def fresh(self) -> BoolArray:
        """[B] episodes that started at a recorded failure."""
        return np.array([episode.way is None for episode in self._episodes])

    @property
    def share(self) -> float:
        """The present share of new episodes that revisit."""
        recent = self._recent[: max(1, min(self._fresh_count, RECENT))].mean()
        return self._share * max(0.0, 1.0 - float(recent) / ENOUGH) * min(1.0, len(self._candidates()) / MANY)

    def begin(self, slots: IntArray) -> tuple[IntArray, RevisitMoments | None]:
        """New episodes in `slots` [K]: the slots of those that revisit, and the moments that they start at."""
        self.forget(slots)
        back = slots[self._rng.random(len(slots)) < self.share]
        if not len(back):
            return back, None
        candidates = self._candidates()
        weight = np.array([1.0 - failure.success for failure, _ in candidates]) + SELDOM
        places = self._rng.choice(len(candidates), size=len(back), p=weight / weight.sum())
        moments = []
        for slot, place in zip(back, places, strict=True):
            failure, way = candidates[place]
            chance = way.success * (1.0 - way.success) + SELDOM
            moment = int(self._rng.choice(len(way), p=chance / chance.sum()))
            self._episodes[slot] = _Episode(failure, way, moment)
            moments.append(way.moments.take(np.array([moment])))
        return back, RevisitMoments.join(moments)

    def forget(self, slots: IntArray) -> None:
        """Blank episodes in `slots` [K], which start at recorded failures."""
        for slot in slots:
            self._episodes[slot] = _Episode()

    def record(self, slots: IntArray, moments: RevisitMoments) -> None:
        """Record the moments [K] before a decision in `slots` [K]."""
        if self._trace is None:
            self._trace = moments.take(np.zeros(len(self._episodes) * self._decisions, dtype=np.int64))
        self._trace.put(slots * self._decisions + moments.decisions, moments)
        for slot, decision, state in zip(slots, moments.decisions.tolist(), moments.state, strict=True):
            episode = self._episodes[slot]
            episode.last = decision
            if episode.way is None and decision == 0:
                episode.failure = self._failures.setdefault(state.tobytes(), _Failure())

    def end(self, slots: IntArray, success: BoolArray, *, simulated: bool = True) -> None:
        """End the episodes of `slots` [K], with `success` [K]; one without simulation counts, but leaves no way."""
        for slot, well in zip(slots, success.tolist(), strict=True):
            episode = self._episodes[slot]
            if episode.way is not None:
                way_success = episode.way.success
                way_success[episode.moment] += FOLLOW * (well - way_success[episode.moment])
                continue
            self._recent[self._fresh_count % RECENT] = well
            self._fresh_count += 1
            episode.failure.success += FOLLOW * (well - episode.failure.success)
            if well and simulated:
                self._keep(int(slot), episode)

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Everything that decides its future, for a checkpoint."""
        known = list(self._failures.values())
        blank = [one.failure for one in self._episodes if not any(one.failure is each for each in known)]
        failures = [*known, *blank]
        ways = [(place, one.way) for place, one in enumerate(failures) if one.way is not None]
        # A slot may revisit a way that a shorter one has replaced since.
        ways += [(-1, one.way) for one in self._episodes if one.way and not any(one.way is each for _, each in ways)]
        places = {id(way): place for place, (_, way) in enumerate(ways)}
        numbers = {id(failure): place for place, failure in enumerate(failures)}
        keys = [np.frombuffer(key, dtype=np.uint8) for key in self._failures]
        state: dict[str, npt.NDArray[Any]] = {
            "rng": generator_state(self._rng),
            "recent": self._recent,
            "fresh_count": np.array(self._fresh_count),
            "keys": np.stack(keys) if keys else np.zeros((0, 0), dtype=np.uint8),
            "success": np.array([failure.success for failure in failures]),
            "way_of": np.array([place for place, _ in ways], dtype=np.int64),
            "failure": np.array([numbers[id(one.failure)] for one in self._episodes]),
            "way": np.array([-1 if one.way is None else places[id(one.way)] for one in self._episodes]),
            "moment": np.array([one.moment for one in self._episodes]),
            "last": np.array([one.last for one in self._episodes]),
        }
        for place, (_, way) in enumerate(ways):
            state |= {f"way.{place}.{name}": value for name, value in way.moments.arrays().items()}
            state[f"way.{place}.chance"] = way.success
        if self._trace is not None:
            state |= {f"trace.{name}": value for name, value in self._trace.arrays().items()}
        return state

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """From what `state` gave, with the same slots."""
        restore_generator(self._rng, state["rng"])
        self._recent, self._fresh_count = np.array(state["recent"]), int(state["fresh_count"])
        failures = [_Failure(success) for success in state["success"].tolist()]
        self._failures = {key.tobytes(): failures[place] for place, key in enumerate(state["keys"])}
        ways = []
        for place, owner in enumerate(state["way_of"].tolist()):
            moments = RevisitMoments.from_arrays(part(state, f"way.{place}."))
            ways.append(_Way(moments, np.array(state[f"way.{place}.chance"])))
            if owner >= 0:
                failures[owner].way = ways[-1]
        columns = (state[name].tolist() for name in ("failure", "way", "moment", "last"))
        self._episodes = [
            _Episode(failures[failure], None if way < 0 else ways[way], moment, last)
            for failure, way, moment, last in zip(*columns, strict=True)
        ]
        trace = part(state, "trace.")
        self._trace = RevisitMoments.from_arrays(trace) if trace else None

    def _candidates(self) -> list[tuple[_Failure, _Way]]:
        """Failures that can be revisited, with their ways."""
        ways = [(failure, failure.way) for failure in self._failures.values()]
        return [(failure, way) for failure, way in ways if way is not None and len(way) > 1]

    def _keep(self, slot: int, episode: _Episode) -> None:
        """Keep the way of a successful episode, if its failure has no shorter one."""
        length = episode.last + 1
        if self._trace is None or (episode.failure.way is not None and len(episode.failure.way) <= length):
            return
        moments = self._trace.take(slot * self._decisions + np.arange(length))
        episode.failure.way = _Way(moments, np.full(length, 0.5))
