#!/usr/bin/env python3
"""What guides gain, as the rows of docs/measurements/guides.md.

usage: guides_table.py [FOLDER]

The first table: the pooled squared noise due to light paths (`C^2 + F^2`) without a guide over that with one, and the
photons of an iteration. The second: true errors of daylight after the same time on one thread, two seeds, against one
render of two minutes with another seed. FOLDER keeps the images. The program is $BDPM, or target/release/bdpm.
"""

import json
import math
import os
import subprocess
import sys
import tempfile

BDPM = os.environ.get("BDPM", "target/release/bdpm")
SCENES = ["daylight", "point-caustic", "caustic-sphere", "cornell-box-classic", "materials", "keyhole", "hall"]
COUNTS = "--resolution 128x128 --light-paths 50000 --camera-paths 2 --iterations 32 --merge-vertex 1".split()


def run(*arguments):
    command = [BDPM, *arguments, "--json"]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def analyze(folder, scene, guide):
    """Squared noise due to light paths, its standard error, and photons."""
    out = f"{folder}/{scene}-{guide}.exr"
    found = run("analyze", f"scenes/{scene}", *COUNTS, "--guide", str(guide), "--quiet", "--output", out)
    pairs, _, light = found["noise"]["pooled_terms"]
    square = pairs["value"] ** 2 + light["value"] ** 2
    error = 2 * math.hypot(*(term["value"] * (term["error"] or 0) for term in (pairs, light)))
    return square, error, found["photons_per_iteration"]


def gains(folder):
    print("| scene | gain | photons without | with |\n|---|---|---|---|")
    for scene in SCENES:
        (without, first, few), (guided, second, many) = (analyze(folder, scene, guide) for guide in (0, 32))
        gain = without / guided
        error = gain * math.hypot(first / without, second / guided)
        print(f"| {scene} | {gain:.2f} +- {error:.2f} | {few:.0f} | {many:.0f} |", flush=True)


def render(folder, name, seconds, *options):
    out = f"{folder}/{name}.exr"
    common = ["--resolution", "128x128", "--time", f"{seconds}s", "--no-denoise", "--quiet", "--output", out]
    return out, run("render", "scenes/daylight", *common, *options)


def equal_time(folder):
    reference, _ = render(folder, "reference", 120, "--seed", "9")
    print("\n| daylight, 6 s, one thread | true error | reported |\n|---|---|---|")
    for name, options in (("without options", []), ("`--guide 0`", ["--guide", "0"])):
        squares, reports = [], []
        for seed in ("1", "2"):
            image, result = render(folder, f"{name}-{seed}".strip("`"), 6, "--threads", "1", "--seed", seed, *options)
            squares.append(run("compare", image, reference)["relative_mse"])
            reports.append(result["error"]["total"] ** 2)
        true, stated = (100 * math.sqrt(sum(of) / 2) for of in (squares, reports))
        print(f"| {name} | {true:.1f} % | {stated:.1f} % |", flush=True)


def main():
    with tempfile.TemporaryDirectory() as temporary:
        folder = sys.argv[1] if len(sys.argv) > 1 else temporary
        gains(folder)
        equal_time(folder)


if __name__ == "__main__":
    main()
