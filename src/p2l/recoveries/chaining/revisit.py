"""Episodes that go on from moments of earlier episodes that were paid.

Where random decisions are hardly ever paid (in 0.7 % of the shelf's episodes), a rollout of 120 decisions seldom holds
a success, and PPO has little to go by. The simulator restores any moment, as it restores the recorded failures; so some
episodes start in the middle of an earlier success, where little is left to do: its last decision is learnt first, then
the one before, back to the failure (as Florensa et al., 2017, and Salimans and Chen, 2018, learn backwards). Moments
that sometimes lead to pay are preferred to those that always or never do. A new way takes the place of moments
that lead to pay most often; those that never do stay, since what is learnt later may reach the goal from there.
A success of one decision is not kept: nothing of it is left to do. Where one option pays for a few failures at once
(11 % of the cluttered shelf's), going back to those would teach that option for all of them, and longer ways that pay
for more would not be found.

Moments are chosen by how they turned out. Where the state tells only part of what matters, an option that is paid there
is seldom paid in others that look alike, and too many such episodes teach what luck did. So their share falls with the
recent success from recorded failures, and is 0 once that is `ENOUGH` for PPO to go by.

1. The thesis starts every episode at a recorded failure. Here, too, only those count in a round's success, and
   evaluations start nowhere else. All simulated control steps count.
2. A resumed run gathers moments, and its recent success, anew.

Axis letters: B slots, K decisions or episodes, O observation columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.worlds.world import Rows

CAPACITY = 256  # moments
RECENT = 100  # episodes from recorded failures that the recent success is taken over
ENOUGH = 0.2  # recent success at which no episode goes back any more
FOLLOW = 0.3  # how fast a moment's success follows what came of it
SELDOM = 0.01  # weight of a moment that always or never leads to pay, beside p (1 − p) of its success
_FRESH, _GONE = -1, -2  # an episode that started at a recorded failure, or at a moment that has been overwritten


@dataclass(frozen=True)
class Moments:
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

    def take(self, index: IntArray) -> Moments:
        """Those of `index`."""
        return Moments(
            rows=self.rows.take(index),
            state=self.state[index],
            decisions=self.decisions[index],
            primitive_steps=self.primitive_steps[index],
            muted=self.muted[index],
        )

    def put(self, index: IntArray, moments: Moments) -> None:
        """Overwrite those of `index`; only who made this record's arrays may do so."""
        self.rows.put(index, moments.rows)
        for name in ("state", "decisions", "primitive_steps", "muted"):
            getattr(self, name)[index] = getattr(moments, name)


class Revisits:
    """What episodes under way went through, and the moments kept of those that were paid.

    Args:
        share: of new episodes that go on from an earlier success while the recent success is 0, in [0, 1].
        slots: B.
        decisions: most decisions of an episode.
        rng: which episodes, and from where.
    """

    def __init__(self, share: float, slots: int, decisions: int, rng: np.random.Generator) -> None:
        self._share, self._decisions, self._rng = share, decisions, rng
        self._first = np.zeros(slots, dtype=np.int64)  # decision that the episode started with
        self._last = np.zeros(slots, dtype=np.int64)  # its latest one
        self._origin = np.full(slots, _FRESH)  # place of the moment it started at
        self._recent = np.zeros(RECENT)
        self._ended = 0
        self._way: Moments | None = None  # [B · decisions]
        self._kept: Moments | None = None  # [CAPACITY]
        self._success = np.full(CAPACITY, np.inf)  # of episodes from there; infinite: an empty place

    @property
    def fresh(self) -> BoolArray:
        """[B] episodes that started at a recorded failure."""
        return np.asarray(self._origin == _FRESH)

    def begin(self, slots: IntArray) -> tuple[IntArray, Moments | None]:
        """New episodes in `slots` [K]: those of them that go back, and the moments they go back to."""
        self.forget(slots)
        known = np.flatnonzero(np.isfinite(self._success))
        if self._kept is None or not len(known):
            return slots[:0], None
        recent = self._recent[: max(1, min(self._ended, RECENT))].mean()
        back = slots[self._rng.random(len(slots)) < self._share * (1.0 - recent / ENOUGH)]
        weight = self._success[known] * (1.0 - self._success[known]) + SELDOM
        self._origin[back] = self._rng.choice(known, size=len(back), p=weight / weight.sum())
        moments = self._kept.take(self._origin[back])
        self._first[back] = moments.decisions
        return back, moments

    def forget(self, slots: IntArray) -> None:
        """The episodes of `slots` [K] start at recorded failures."""
        self._first[slots], self._origin[slots] = 0, _FRESH

    def passing(self, slots: IntArray, moments: Moments) -> None:
        """The moments [K] before a decision in `slots` [K]."""
        if self._way is None:
            self._way = moments.take(np.zeros(len(self._first) * self._decisions, dtype=np.int64))
            self._kept = moments.take(np.zeros(CAPACITY, dtype=np.int64))
        self._last[slots] = moments.decisions
        self._way.put(slots * self._decisions + moments.decisions, moments)

    def ended(self, slots: IntArray, paid: BoolArray, *, simulated: bool = True) -> None:
        """The episodes of `slots` [K] have ended; `paid` [K]: well. An unsimulated pay is believed, but not kept."""
        fresh = self.fresh[slots]
        self._recent[(self._ended + np.arange(int(fresh.sum()))) % RECENT] = paid[fresh]
        self._ended += int(fresh.sum())
        for place, well in zip(self._origin[slots].tolist(), paid.tolist(), strict=True):
            if place >= 0:
                self._success[place] += FOLLOW * (well - self._success[place])
        if simulated:
            self._keep(slots[paid & (self._first[slots] == 0) & (self._last[slots] > 0)])

    def _keep(self, slots: IntArray) -> None:
        """Whole ways of episodes that were paid, in place of the moments that lead to pay most often."""
        if self._way is None or self._kept is None or not len(slots):
            return
        step = np.arange(self._decisions)
        places = (slots[:, None] * self._decisions + step)[step <= self._last[slots, None]][:CAPACITY]
        worn = np.argsort(-self._success, kind="stable")[: len(places)]
        self._kept.put(worn, self._way.take(places))
        self._success[worn] = 0.5
        self._origin[np.isin(self._origin, worn)] = _GONE
