"""A progress bar with rate and time left; silent where there is no terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

from p2l.contracts.domain import Progress


@contextmanager
def bar(title: str, unit: str = "it") -> Iterator[Progress]:
    """Yield a function (done, total); when `done` falls back a new phase has begun and the bar starts over."""
    shown = tqdm(desc=title, unit=unit, disable=None, leave=False)

    def show(done: int, total: int) -> None:
        if done < shown.n or shown.total != total:
            shown.reset(total)
        shown.update(done - shown.n)

    try:
        yield show
    finally:
        shown.close()


@contextmanager
def counter(title: str, unit: str, total: int) -> Iterator[Callable[[int], None]]:
    """Yield a function of how many were finished since its last call."""
    with tqdm(desc=title, unit=unit, total=total, disable=None, leave=False) as shown:

        def show(more: int) -> None:
            shown.update(more)

        yield show


@contextmanager
def late_counter(title: str, unit: str) -> Iterator[Callable[[int], Callable[[int], None]]]:
    """Yield a function that is told the total once it is known, and gives that of `counter`."""
    with tqdm(desc=title, unit=unit, disable=None, leave=False) as shown:

        def begin(total: int) -> Callable[[int], None]:
            shown.reset(total)

            def show(more: int) -> None:
                shown.update(more)

            return show

        yield begin


@contextmanager
def training(title: str, total: int) -> Iterator[Callable[[int, float | None], None]]:
    """Yield a function of the control steps so far and the success rate of the last round.

    Without a success rate, the steps are those of a run that is resumed: they count for no rate and no time left.
    """
    with tqdm(desc=title, unit=" steps", total=total, disable=None, leave=False, smoothing=0.05) as shown:

        def show(done: int, success: float | None) -> None:
            if success is None:
                shown.initial = shown.n = shown.last_print_n = min(done, total)
                return
            shown.set_postfix_str(f"success {success:.0%}", refresh=False)
            shown.update(min(done, total) - shown.n)

        yield show
