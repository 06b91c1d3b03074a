#!/usr/bin/env python3
"""Whole paths per pixel and second of bdpm and of Mitsuba's path tracer, in turn, as the rows of a table.

usage: path_speed.py [--bdpm PROGRAM] [--seconds S] [--rounds N] [--threads N] [--width W] SCENE.xml...

Wants Mitsuba 3 (`pip install mitsuba numpy`). Both programs trace paths of unlimited length with a box filter:
Mitsuba with `path`, bdpm with `--strategy path`. Seconds are those of rendering alone: Mitsuba's kernels are compiled
before, and bdpm counts neither reading nor writing. The numbers are medians of the rounds.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile
import time

from mitsuba_paths import PathTracer

# Of each pixel in an iteration: the usual choice of automatic renders
CAMERA_PATHS = 3


def mitsuba_speed(tracer, seconds, first_seed):
    start, passes = time.perf_counter(), 0
    while time.perf_counter() - start < seconds:
        tracer.render_pass(first_seed + passes)
        passes += 1
    return passes * tracer.samples / (time.perf_counter() - start)


def bdpm_speed(options, path, size, iterations):
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "image.exr"
        command = [options.bdpm, "render", str(path), "--output", str(out), "--strategy", "path"]
        command += ["--camera-paths", str(CAMERA_PATHS), "--iterations", str(iterations), "--threads", str(options.threads)]
        command += ["--resolution", "{}x{}".format(*size), "--layers", "none", "--json", "--quiet"]
        run = subprocess.run(command, capture_output=True, text=True, check=True)
        return iterations * CAMERA_PATHS / json.loads(run.stdout)["seconds"]["render"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bdpm", default="target/release/bdpm")
    parser.add_argument("--seconds", type=float, default=5)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("scenes", nargs="+", type=pathlib.Path)
    options = parser.parse_args()
    print("| scene | pixels | Mitsuba | bdpm | bdpm over Mitsuba |\n|---|---|---|---|---|")
    for path in options.scenes:
        tracer = PathTracer(path, options.width, options.threads)
        tracer.render_pass(1)
        per_second = bdpm_speed(options, path, tracer.size, 3)
        iterations = max(3, round(per_second * options.seconds / CAMERA_PATHS))
        rounds = []
        for number in range(options.rounds):
            their = mitsuba_speed(tracer, options.seconds, 100 * (1 + number))
            rounds.append((their, bdpm_speed(options, path, tracer.size, iterations)))
        theirs, ours = (statistics.median(column) for column in zip(*rounds))
        ratio = statistics.median(own / their for their, own in rounds)
        name = path.parent.name or path.stem
        print(f"| {name} | {tracer.size[0]}x{tracer.size[1]} | {theirs:.1f} | {ours:.1f} | {ratio:.2f} |", flush=True)


main()
