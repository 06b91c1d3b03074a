#!/usr/bin/env bash
# Installs the wheel into a fresh environment, renders with it, and executes the notebooks of python/notebooks.
#
#   scripts/check-notebooks.sh WHEEL [NOTEBOOK.ipynb...]
#
# The notebook beside Mitsuba is skipped where Mitsuba does not run. STORE=1 keeps the outputs in the notebooks: run it
# on a machine that does nothing else, and look at them before you commit them.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
wheel=$(realpath "$1")
shift
[ $# -gt 0 ] || set -- "$root"/python/notebooks/*.ipynb

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
python=$work/venv/bin/python
"$python" -m pip install --quiet --disable-pip-version-check "$wheel"

# With NumPy alone: the first example of the README of the package, and the program.
(
    cd "$work"
    ln -s "$root/scenes" scenes
    sed -n '/^```python$/,/^```$/p' "$root/python/README.md" | sed '/^```/d; s/time=20/time=2/' | "$python" -
    test -s cornell-box.png
    venv/bin/bdpm render scenes/cornell-box --time 1s --quiet --output program.exr
    test -s program.exr
)

"$python" -m pip install --quiet --disable-pip-version-check "$wheel[notebook]" nbclient mitsuba==3.9.1
"$python" - "$@" <<'END'
import os
import subprocess
import sys
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient

has_mitsuba = subprocess.run([sys.executable, "-c", "import mitsuba"], stderr=subprocess.DEVNULL).returncode == 0
for path in map(Path, sys.argv[1:]):
    if path.name == "mitsuba.ipynb" and not has_mitsuba:
        print("mitsuba.ipynb: skipped: Mitsuba does not run here (Debian: apt install libatomic1)")
        continue
    start = time.monotonic()
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": path.parent}}).execute()
    print(f"{path.name}: {time.monotonic() - start:.0f} s")
    if os.environ.get("STORE"):
        for cell in notebook.cells:
            # Times of execution, which differ each time
            cell.metadata.clear()
            # Bars of progress, and what pip prints
            if "outputs" in cell:
                cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr"]
        nbformat.write(notebook, path)
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            if output.output_type == "stream" and output.name == "stdout":
                print(output.text, end="")
END
