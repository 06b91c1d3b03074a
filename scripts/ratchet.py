#!/usr/bin/env python3
"""Compares the images of this checkout with those of another commit, at equal time.

    scripts/ratchet.py COMMIT [--seconds 10] [--large] [--seeds 2] [--true] [SCENE ...]

Builds COMMIT once in target/ratchet/COMMIT. Then both programs render each scene without options, in turn, since the
speed of machines drifts. The squared error is the noise between the seeds, relative to the squared luminance of each
pixel, and the stated bias. Prints a Markdown table: both errors, the factor between the squared errors (below 1 is
better), both strategies, and faults. With --true the squared error is that to references, one minute of this checkout
each, which are kept in target/ratchet/references: bias that nobody stated counts, and the noise of the reference is
subtracted as it is stated. --large adds rows of 1920x1080 pixels in three times the time. Exit code 1 if a
factor exceeds 1.3, or a render fails, states no error, or ends over 10 % and a second late. Run it on a machine that
does nothing else, after every change of choices, kernels or loops. 10 minutes, 8 more with --large.
"""

import argparse
import functools
import json
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "target/ratchet"
SCENES = "cornell-box caustic-sphere point-caustic keyhole materials office daylight hall smoke diamond-ring".split()
LARGE = "hall materials caustic-sphere office".split()
REFERENCE_SECONDS, REFERENCE_SEED = 60.0, 1000
LUMINANCE = [0.2126, 0.7152, 0.0722]


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commit", help="commit to compare with")
    parser.add_argument("scenes", nargs="*", help="scene files or folders [default: those of this repository]")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--true", action="store_true", help="errors to references")
    return parser.parse_args()


def in_environment():
    """Runs this script again with numpy and OpenEXR, which are installed into a folder of its own."""
    python = FOLDER / "venv/bin/python"
    if Path(sys.prefix).resolve() == python.parent.parent.resolve():
        return
    if not python.exists():
        subprocess.check_call([sys.executable, "-m", "venv", str(FOLDER / "venv")])
        subprocess.check_call([str(python), "-m", "pip", "install", "--quiet", "numpy", "OpenEXR"])
    sys.exit(subprocess.call([str(python), *sys.argv]))


def base_program(commit):
    """The program of another commit, built unless it is there, and the short name of the commit."""
    name = subprocess.check_output(["git", "rev-parse", "--short=8", commit], cwd=ROOT, text=True).strip()
    tree = FOLDER / name
    program = tree / "target/release/bdpm"
    if not program.exists():
        if not tree.exists():
            subprocess.check_call(["git", "worktree", "add", "--detach", str(tree), name], cwd=ROOT)
        subprocess.check_call(["make", "--silent", "build"], cwd=tree)
    return program, name


@functools.cache
def told(program):
    """The options of a program: older ones denoise nothing that they are not asked to."""
    return subprocess.check_output([str(program), "render", "--help"], text=True)


def render(program, scene, size, seconds, seed):
    """Luminances of an image, its report, and what is wrong with it."""
    import numpy
    import OpenEXR

    with tempfile.TemporaryDirectory() as folder:
        image = Path(folder) / "image.exr"
        begun = time.monotonic()
        options = ["--resolution", size, "--time", f"{seconds:g}s", "--seed", str(seed), "--layers", "none"]
        if "--no-denoise" in told(program):
            options.append("--no-denoise")
        command = [program, "render", scene, "--output", image, *options, "--json", "--quiet"]
        run = subprocess.run([str(part) for part in command], capture_output=True, text=True)
        took = time.monotonic() - begun
        if run.returncode != 0 or not image.exists():
            return None, None, "fails: " + (run.stderr.strip().splitlines() or ["?"])[-1][:80]
        report = json.loads(run.stdout)
        faults = []
        if not (report.get("error") or {}).get("total"):
            faults.append("no error stated")
        if took > 1.1 * seconds + 1:
            faults.append(f"{took:.0f} s of {seconds:g}")
        with OpenEXR.File(str(image), separate_channels=True) as file:
            channels = file.channels()
            pixels = numpy.stack([numpy.asarray(channels[name].pixels, float) for name in "RGB"], -1)
        return pixels @ numpy.array(LUMINANCE), report, ", ".join(faults)


def smoothed(image, reach=2):
    """Means over squares around each pixel."""
    import numpy

    wide = numpy.pad(image, reach, mode="edge")
    height, width = image.shape
    steps = range(2 * reach + 1)
    return sum(wide[y : y + height, x : x + width] for y in steps for x in steps) / len(steps) ** 2


def squared_error(images, reports, weights):
    """Noise between images of different seeds, and the bias that they state."""
    import numpy

    noise = float(numpy.mean(numpy.var(images, axis=0, ddof=1) * weights))
    return noise + float(numpy.mean([((own.get("error") or {}).get("bias") or 0.0) ** 2 for own in reports]))


def reference(program, scene, size):
    """A long render of a scene and its squared relative noise, rendered once."""
    import numpy

    path = Path(scene).resolve()
    name = "-".join(path.with_suffix("").parts[-2:])
    stored = FOLDER / f"references/{name}-{size}.npz"
    if not stored.exists():
        stored.parent.mkdir(parents=True, exist_ok=True)
        image, report, fault = render(program, scene, size, REFERENCE_SECONDS, REFERENCE_SEED)
        if image is None:
            sys.exit(f"{scene}: {fault}")
        numpy.savez_compressed(stored, image=image.astype(numpy.float32), noise2=report["error"]["noise"] ** 2)
    with numpy.load(stored) as own:
        return own["image"].astype(float), float(own["noise2"])


def true_error(images, reference, noise2):
    """Mean squared error to a reference, relative to its squared luminance."""
    import numpy

    weights = 1 / (reference**2 + 0.01 * reference.mean() ** 2)
    squares = [float(numpy.mean((image - reference) ** 2 * weights)) for image in images]
    return max(float(numpy.mean(squares)) - noise2, 1e-12)


def strategies(reports):
    names = [own["settings"] for own in reports]
    return ", ".join(own["strategy"] + (str(own["merge_vertex"]) if own["strategy"] == "single" else "") for own in names)


def main():
    import numpy

    own = arguments()
    program, commit = base_program(own.commit)
    programs = [program, ROOT / "target/release/bdpm"]
    scenes = own.scenes or [str(ROOT / "scenes" / name) for name in SCENES]
    rows = [(scene, "160x120", own.seconds) for scene in scenes]
    if own.large:
        rows += [(str(ROOT / "scenes" / name), "1920x1080", 3 * own.seconds) for name in LARGE]
    print(f"| scene | size | {commit} | now | factor | strategies before | now | faults |\n|---|---|---|---|---|---|---|---|")
    is_worse, logarithms = False, []
    for scene, size, seconds in rows:
        images, reports, faults = ([], []), ([], []), []
        for seed in range(1, own.seeds + 1):
            for which in (0, 1) if seed % 2 else (1, 0):
                image, report, fault = render(programs[which], scene, size, seconds, seed)
                if which == 1 and fault:
                    faults.append(fault)
                if image is not None:
                    images[which].append(image)
                    reports[which].append(report)
        is_worse |= bool(faults)
        name = Path(scene).parent.name if Path(scene).suffix else Path(scene).name
        if min(map(len, images)) < 2:
            print(f"| {name} | {size} | | | | | | {'; '.join(faults) or 'the other commit fails'} |", flush=True)
            continue
        mean = smoothed(sum(images[0] + images[1]) / len(images[0] + images[1]))
        weights = 1 / (mean**2 + 0.01 * mean.mean() ** 2)
        if own.true:
            known = reference(programs[1], scene, size)
            before, now = (true_error(images[which], *known) for which in (0, 1))
        else:
            before, now = (squared_error(images[which], reports[which], weights) for which in (0, 1))
        factor = now / before
        is_worse |= factor > 1.3
        logarithms.append(math.log(factor))
        chosen = " | ".join(strategies(of) for of in reports)
        errors = f"{100 * before**0.5:.2f} % | {100 * now**0.5:.2f} %"
        print(f"| {name} | {size} | {errors} | {factor:.2f} | {chosen} | {'; '.join(faults)} |", flush=True)
    print(f"\nGeometric mean of the factors: {math.exp(float(numpy.mean(logarithms))):.2f}")
    sys.exit(is_worse)


if __name__ == "__main__":
    in_environment()
    main()
