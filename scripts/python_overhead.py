"""Time and memory of the Python package beside the program at equal settings, in turn, and whether the images agree.

    venv/bin/python scripts/python_overhead.py scenes/cornell-box 48 512x512 5     # scene, iterations, pixels, runs

Run it with the interpreter of an environment that has the wheel. The program is the one of the wheel.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import bdpm
import numpy as np

PROGRAM = Path(bdpm.__file__).parent / "bin/bdpm"
COUNTS = {"light_paths": 100_000, "camera_paths": 2}
RENDER = """
import json, sys, bdpm
scene, iterations, width, height, file = sys.argv[1:]
size = (int(width), int(height))
result = bdpm.render(bdpm.load(scene), iterations=int(iterations), resolution=size, layers=[], **{counts})
result.image.tofile(file)
"""


def run(arguments):
    """Wall-clock time, processor time and peak memory of a process: seconds, seconds, MiB."""
    start = time.perf_counter()
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{arguments[0]} failed")
    return time.perf_counter() - start, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def main(scene, iterations, pixels, runs):
    folder = Path(tempfile.mkdtemp())
    exr, raw = folder / "program.exr", folder / "python.f32"
    options = [f"--{name.replace('_', '-')}={count}" for name, count in COUNTS.items()]
    options += ["--iterations", iterations, "--resolution", pixels, "--layers", "none", "--quiet"]
    code = RENDER.replace("{counts}", json.dumps(COUNTS))
    rows = []
    for _ in range(int(runs)):
        program = run([PROGRAM, "render", scene, "--output", exr, *options])
        python = run([sys.executable, "-c", code, scene, iterations, *pixels.split("x"), raw])
        rows.append((program, python))
        print("program {:.2f} s, {:.2f} s of processors, {:.0f} MiB".format(*program), end="; ")
        print("python {:.2f} s, {:.2f} s of processors, {:.0f} MiB".format(*python), flush=True)
    for index, name in enumerate(("time", "processor time", "memory")):
        ratio = statistics.median(python[index] / program[index] for program, python in rows)
        print(f"{name} of python over that of the program: median {ratio:.4f}")
    image = bdpm.read_exr(exr)[""]
    is_equal = np.array_equal(image, np.fromfile(raw, np.float32).reshape(image.shape))
    print("images are equal" if is_equal else "images DIFFER")


if __name__ == "__main__":
    main(*sys.argv[1:])
