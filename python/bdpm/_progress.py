"""Progress on the screen: a bar, and a live picture in notebooks."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from bdpm._bdpm import Job, Progress

Callback = Callable[[Progress], object]

PICTURE_EVERY = 1.0  # seconds


def is_notebook() -> bool:
    """True in a kernel of Jupyter."""
    return "ipykernel" in sys.modules


def _describe(progress: Progress) -> str:
    if progress.iterations == 0:
        return "choosing the technique"
    words = [f"{progress.iterations} iterations"]
    if progress.error is not None:
        words.append(f"error {100 * progress.error:.2f} %")
    if progress.expected_error is not None:
        words.append(f"to {100 * progress.expected_error:.2f} %")
    if progress.seconds_left is not None:
        words.append(f"{progress.seconds_left:.0f} s left")
    return ", ".join(words)


class _Bar:
    """A bar of tqdm."""

    def __init__(self, tqdm: Any) -> None:
        self._bar = tqdm(total=1.0, bar_format="{percentage:3.0f}%|{bar}| {desc}")

    def __call__(self, progress: Progress) -> None:
        self._bar.n = round(progress.done, 3)
        self._bar.set_description_str(_describe(progress))

    def close(self) -> None:
        self._bar.close()


class _Line:
    """A line of text on stderr, if there is no tqdm."""

    def __call__(self, progress: Progress) -> None:
        print(f"\r\033[K{100 * progress.done:3.0f} % {_describe(progress)}", end="", file=sys.stderr, flush=True)

    def close(self) -> None:
        print(file=sys.stderr)


class _Picture:
    """The image so far, as an output of a notebook."""

    def __init__(self, job: Job) -> None:
        from IPython.display import display

        self._job = job
        self._handle: Any = display(job, display_id=True)
        self._next = time.monotonic() + PICTURE_EVERY

    def __call__(self, progress: Progress) -> None:
        if progress.iterations > 0 and time.monotonic() >= self._next:
            self._handle.update(self._job)
            self._next = time.monotonic() + PICTURE_EVERY

    def close(self) -> None:
        self._handle.update(self._job)


def _bar(is_required: bool) -> _Bar | _Line | None:
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return _Line() if is_required else None
    return _Bar(tqdm)


@contextmanager
def shown(progress: bool | Callback | None, job: Job | None = None) -> Iterator[Callback | None]:
    """The callback for the argument `progress`, and for the live picture of `job` if it is given."""
    parts: list[_Bar | _Line | _Picture] = []
    if progress is True or (progress is None and is_notebook()):
        bar = _bar(is_required=progress is True)
        parts += [bar] if bar else []
    if job is not None:
        parts.append(_Picture(job))
    user = progress if callable(progress) else None

    def call(now: Progress) -> object:
        for part in parts:
            part(now)
        return user(now) if user else None

    try:
        yield call if parts else user
    finally:
        for part in parts:
            part.close()
