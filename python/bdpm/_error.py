"""The exception of the package."""

from __future__ import annotations


class Error(Exception):
    """A problem that the user can solve. `str()` shows all of it.

    - `problem`: what is wrong.
    - `help`: what to do.
    - `file`: the file that the problem is about, or None.
    - `line`: the one-based line in the file, or None.
    """

    def __init__(
        self, text: str, *, problem: str = "", help: str = "", file: str | None = None, line: int | None = None
    ) -> None:
        super().__init__(text)
        self.problem = problem
        self.help = help
        self.file = file
        self.line = line
