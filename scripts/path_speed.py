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

import mitsuba

mitsuba.set_variant("llvm_ad_rgb")

import drjit  # noqa: E402
import numpy as np  # noqa: E402

# Samples of one call: Mitsuba holds them all in memory
PASS = 1 << 21


class Mitsuba:
    def __init__(self, path, width, threads):
        drjit.set_thread_count(2)
        mitsuba.file_resolver().prepend(str(path.parent))
        self.scene = mitsuba.load_file(str(path))
        film = mitsuba.traverse(self.scene.sensors()[0])
        w, h = film["film.size"]
        self.size = (width, round(width * h / w))
        film["film.size"] = list(self.size)
        film.update()
        drjit.set_thread_count(threads)
        self.integrator = mitsuba.load_dict({"type": "path", "max_depth": -1, "rr_depth": 5})
        self.samples = max(1, PASS // (self.size[0] * self.size[1]))
        for seed in range(2):
            self.render(seed)

    def render(self, seed):
        np.array(mitsuba.render(self.scene, integrator=self.integrator, spp=self.samples, seed=seed))

    def speed(self, seconds, first_seed):
        start, passes = time.perf_counter(), 0
        while time.perf_counter() - start < seconds:
            self.render(first_seed + passes)
            passes += 1
        return passes * self.samples / (time.perf_counter() - start)


def bdpm_speed(options, path, size, iterations):
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "image.exr"
        command = [options.bdpm, "render", str(path), "--output", str(out), "--strategy", "path"]
        command += ["--camera-paths", "1", "--iterations", str(iterations), "--threads", str(options.threads)]
        command += ["--resolution", "{}x{}".format(*size), "--layers", "none", "--json", "--quiet"]
        start = time.perf_counter()
        run = subprocess.run(command, capture_output=True, text=True, check=True)
        seconds = time.perf_counter() - start
        own = json.loads(run.stdout)["seconds"]
        return iterations / (seconds - own["load"] - own["write"])


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
        judge = Mitsuba(path, options.width, options.threads)
        iterations = max(8, round(bdpm_speed(options, path, judge.size, 8) * options.seconds))
        rounds = [
            (judge.speed(options.seconds, 100 * (1 + number)), bdpm_speed(options, path, judge.size, iterations))
            for number in range(options.rounds)
        ]
        theirs, ours = (statistics.median(column) for column in zip(*rounds))
        ratio = statistics.median(own / their for their, own in rounds)
        name = path.parent.name or path.stem
        print(f"| {name} | {judge.size[0]}x{judge.size[1]} | {theirs:.1f} | {ours:.1f} | {ratio:.2f} |", flush=True)


main()
