"""A progress bar with rate and time left; silent where there is no terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

from p2l.contracts.domain import Progress

# tqdm wakes its monitor, a daemon thread, when the interpreter ends and does not wait for it: now and then the thread
# ran on in an interpreter that was gone, and a stage that had finished ended with a segmentation fault.
tqdm.monitor_interval = 0


@contextmanager
def bar(title: str, unit: str = "it") -> Iterator[Progress]:
    """Yield a function (done, total); when `done` falls back a new phase has begun and the bar starts over."""
    progress_bar = tqdm(desc=title, unit=unit, disable=None, leave=False)

    def show(done: int, total: int) -> None:
        if done < progress_bar.n or progress_bar.total != total:
            progress_bar.reset(total)
        progress_bar.update(done - progress_bar.n)

    try:
        yield show
    finally:
        progress_bar.close()


@contextmanager
def counter(title: str, unit: str, total: int) -> Iterator[Callable[[int], None]]:
    """Yield a function of how many were finished since its last call."""
    with tqdm(desc=title, unit=unit, total=total, disable=None, leave=False) as progress_bar:

        def show(more: int) -> None:
            progress_bar.update(more)

        yield show


@contextmanager
def late_counter(title: str, unit: str) -> Iterator[Callable[[int], Callable[[int], None]]]:
    """Yield a function that is told the total once it is known, and gives that of `counter`."""
    with tqdm(desc=title, unit=unit, disable=None, leave=False) as progress_bar:

        def begin(total: int) -> Callable[[int], None]:
            progress_bar.reset(total)

            def show(more: int) -> None:
                progress_bar.update(more)

            return show

        yield begin


def say(line: str) -> None:
    """A line of standard output, above the bar that is shown."""
    tqdm.write(line, file=sys.stdout)


@contextmanager
def training(title: str, total: int) -> Iterator[Callable[[int, float | None], None]]:
    """Yield a function of the control steps so far and the success rate of the last round.

    Without a success rate, the steps are those of a run that is resumed: they count for no rate and no time left.
    """
    with tqdm(desc=title, unit=" steps", total=total, disable=None, leave=False, smoothing=0.05) as progress_bar:

        def show(done: int, success: float | None) -> None:
            if success is None:
                progress_bar.initial = progress_bar.n = progress_bar.last_print_n = min(done, total)
                return
            progress_bar.set_postfix_str(f"success {success:.0%}", refresh=False)
            progress_bar.update(min(done, total) - progress_bar.n)

        yield show
