"""The command `bdpm`, which the wheel carries beside this file."""

import os
import sys
from pathlib import Path


def main() -> None:
    """Replaces this process by the program."""
    program = Path(__file__).parent / "bin" / "bdpm"
    if not program.is_file():
        sys.exit(f"error: there is no program {program}\nhelp: install a wheel of `make wheel`")
    os.execv(program, ["bdpm", *sys.argv[1:]])
