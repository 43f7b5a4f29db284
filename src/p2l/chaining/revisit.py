"""Episodes that go on from moments of earlier episodes that were paid.

Where random decisions are hardly ever paid (in 0.7 % of the shelf's episodes), a rollout of 120 decisions seldom holds
a success, and PPO has little to go by. The simulator restores any moment, as it restores the recorded failures; so some
episodes start in the middle of an earlier success, where little is left to do: its last decision is learnt first, then
the one before, back to the failure (as Florensa et al., 2017, and Salimans and Chen, 2018, learn backwards). Of a
way's moments, those that sometimes lead to pay are preferred to those that always or never do.

One way is kept for each failure, the shortest that was paid, and of the failures that have one, those whose recovery
succeeds least are gone back to most often. Otherwise the failures that are easy to recover from, whose ways are many,
hide those that ask for several right decisions (half of the cluttered shelf's), and what is learnt is to repeat what is
easy. A failure that one decision recovers from is not gone back to: nothing of that way is left to do.

Where the state tells only part of what matters, what is paid at one failure is seldom paid at others that look alike,
and too many such episodes teach what luck did. So their share grows with the failures that can be gone back
to, up to `MANY`, and falls with the recent success from recorded failures, to 0 at `ENOUGH` for PPO to go by.

1. The thesis starts every episode at a recorded failure. Here, too, only those count in a round's success, and
   evaluations start nowhere else. All simulated control steps count.
2. A resumed run gathers ways, and its recent success, anew.

Axis letters: B slots, K decisions or episodes, O observation columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from p2l.contracts.rows import Rows
from p2l.records import Array, BoolArray, IntArray

RECENT = 100  # episodes from recorded failures that the recent success is taken over
ENOUGH = 0.5  # recent success at which no episode goes back any more
MANY = 20  # failures to go back to, from which on their number does not matter
FOLLOW = 0.3  # how fast the success of a failure, or of a moment, follows what came of it
SELDOM = 0.01  # weight of a failure that is always recovered from, and of a moment that always or never leads to pay


@dataclass(frozen=True)
class RevisitMoments:
    """K moments before a decision.

    Attributes:
        rows: [K] the simulation.
        state: [K, O] the agent's.
        decisions: [K] taken before.
        primitive_steps: [K] control steps spent in primitives before.
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
        """Overwrite those of `index`; only who made this record's arrays may do so."""
        self.rows.put(index, moments.rows)
        for name in ("state", "decisions", "primitive_steps", "muted"):
            getattr(self, name)[index] = getattr(moments, name)

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
    """Moments of an episode that was paid, from its failure to its last decision; how episodes from each turn out."""

    moments: RevisitMoments
    success: Array

    def __len__(self) -> int:
        return len(self.success)


@dataclass
class _Failure:
    """A recorded failure: the recent success of episodes from it, and its shortest way."""

    solved: float = 0.0
    way: _Way | None = None


@dataclass
class _Episode:
    """What is under way in a slot.

    Attributes:
        failure: that it started at, or whose way it went on from; a blank one before the first decision.
        way: and `moment`: where it went on from; none: at the failure.
        last: number of its latest decision.
    """

    failure: _Failure = field(default_factory=_Failure)
    way: _Way | None = None
    moment: int = 0
    last: int = 0


class Revisits:
    """What episodes under way went through, and the ways kept of those that were paid.

    Args:
        share: of new episodes, at most so many go on from an earlier success, in [0, 1].
        slots: B.
        decisions: most decisions of an episode.
        rng: which episodes, and from where.
    """

    def __init__(self, share: float, slots: int, decisions: int, rng: np.random.Generator) -> None:
        self._share, self._decisions, self._rng = share, decisions, rng
        self._episodes = [_Episode() for _ in range(slots)]
        self._failures: dict[bytes, _Failure] = {}  # by the state they start in: what looks the same is the same
        self._recent = np.zeros(RECENT)
        self._ended = 0
        self._passed: RevisitMoments | None = None  # [B · decisions]

    @property
    def fresh(self) -> BoolArray:
        """[B] episodes that started at a recorded failure."""
        return np.array([episode.way is None for episode in self._episodes])

    @property
    def share(self) -> float:
        """Of new episodes that go back, at present."""
        recent = self._recent[: max(1, min(self._ended, RECENT))].mean()
        return self._share * max(0.0, 1.0 - float(recent) / ENOUGH) * min(1.0, len(self._known()) / MANY)

    def begin(self, slots: IntArray) -> tuple[IntArray, RevisitMoments | None]:
        """New episodes in `slots` [K]: those of them that go back, and the moments they go back to."""
        self.forget(slots)
        back = slots[self._rng.random(len(slots)) < self.share]
        if not len(back):
            return back, None
        known = self._known()
        weight = np.array([1.0 - failure.solved for failure, _ in known]) + SELDOM
        places = self._rng.choice(len(known), size=len(back), p=weight / weight.sum())
        found = []
        for slot, place in zip(back, places, strict=True):
            failure, way = known[place]
            chance = way.success * (1.0 - way.success) + SELDOM
            moment = int(self._rng.choice(len(way), p=chance / chance.sum()))
            self._episodes[slot] = _Episode(failure, way, moment)
            found.append(way.moments.take(np.array([moment])))
        return back, RevisitMoments.join(found)

    def forget(self, slots: IntArray) -> None:
        """The episodes of `slots` [K] start at recorded failures."""
        for slot in slots:
            self._episodes[slot] = _Episode()

    def passing(self, slots: IntArray, moments: RevisitMoments) -> None:
        """The moments [K] before a decision in `slots` [K]."""
        if self._passed is None:
            self._passed = moments.take(np.zeros(len(self._episodes) * self._decisions, dtype=np.int64))
        self._passed.put(slots * self._decisions + moments.decisions, moments)
        for slot, decision, state in zip(slots, moments.decisions.tolist(), moments.state, strict=True):
            episode = self._episodes[slot]
            episode.last = decision
            if episode.way is None and decision == 0:
                episode.failure = self._failures.setdefault(state.tobytes(), _Failure())

    def ended(self, slots: IntArray, paid: BoolArray, *, simulated: bool = True) -> None:
        """The episodes of `slots` [K] have ended; `paid` [K]: well. An unsimulated pay is believed, but not kept."""
        for slot, well in zip(slots, paid.tolist(), strict=True):
            episode = self._episodes[slot]
            if episode.way is not None:
                success = episode.way.success
                success[episode.moment] += FOLLOW * (well - success[episode.moment])
                continue
            self._recent[self._ended % RECENT] = well
            self._ended += 1
            episode.failure.solved += FOLLOW * (well - episode.failure.solved)
            if well and simulated:
                self._keep(int(slot), episode)

    def _known(self) -> list[tuple[_Failure, _Way]]:
        """Failures that can be gone back to."""
        found = [(failure, failure.way) for failure in self._failures.values()]
        return [(failure, way) for failure, way in found if way is not None and len(way) > 1]

    def _keep(self, slot: int, episode: _Episode) -> None:
        """The way of an episode that was paid, if there is no shorter one of its failure."""
        length = episode.last + 1
        if self._passed is None or (episode.failure.way is not None and len(episode.failure.way) <= length):
            return
        moments = self._passed.take(slot * self._decisions + np.arange(length))
        episode.failure.way = _Way(moments, np.full(length, 0.5))
