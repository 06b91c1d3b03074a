"""Mitsuba and bdpm on the same files: how they agree, and what the same time buys. See mitsuba-check.sh."""

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import OpenEXR

ROOT = Path(__file__).resolve().parent.parent
ELEMENTS = ROOT / "tests/data/mitsuba"
BDPM = os.environ["BDPM"]
THREADS = int(os.environ.get("THREADS", os.cpu_count()))
BLOCK = 16
PARTS = 4  # of which references are the mean
DEFAULTS = {"SECONDS_EACH": 10, "RUNS": 3, "SECONDS_REFERENCE": 90}
LONGER_IN_MEDIA = 4  # in the time of surfaces, few iterations merge in media at large radii, with percents of bias
MOST_SAMPLES = 1 << 24  # of one call: compiled variants hold all of them at once


def start_mitsuba(variants=("llvm_ad_rgb", "scalar_rgb")):
    """The first variant that runs here."""
    for variant in variants:
        try:
            mi.set_variant(variant)
            mi.set_log_level(mi.LogLevel.Error)
            dr.set_thread_count(2)  # of one an environment map waits forever while it is read
            mi.load_dict({"type": "scene", "shape": {"type": "sphere"}})
            return variant
        except Exception as problem:
            print(f"mitsuba: {variant} does not run: {str(problem).splitlines()[0]}", file=sys.stderr)
    sys.exit("mitsuba: no variant runs")


def load(path, size=None):
    """The scene with a box filter, unlimited paths and, if given, another size of the film."""
    text = path.read_text()
    text = re.sub(r'(<rfilter type=")\w+"', r'\1box"', text)
    text = re.sub(r'(<default name="integrator" value=")\w+"', r'\1path"', text)
    text = re.sub(r'(<default name="max_depth" value=")-?\d+"', r'\1-1"', text)
    mi.file_resolver().prepend(str(path.parent.resolve()))
    dr.set_thread_count(2)
    scene = mi.load_string(text)
    dr.set_thread_count(THREADS)  # the main thread is one of them
    if size:
        film = mi.traverse(scene.sensors()[0])
        film["film.size"] = size
        film.update()
    return scene


def with_mitsuba(scene, kind, samples, seed):
    """An image of so many samples per pixel, and the seconds that it took."""
    integrator = mi.load_dict({"type": kind, "max_depth": -1, "rr_depth": 5})
    pixels = int(np.prod(scene.sensors()[0].film().size()))
    passes = -(-samples * pixels // MOST_SAMPLES)
    counts = [samples // passes + (part < samples % passes) for part in range(passes)]
    image = 0.0
    start = time.perf_counter()
    for part, count in enumerate(counts):
        with silence():
            own = mi.render(scene, integrator=integrator, spp=count, seed=(seed << 12) + part)
            image = image + count / samples * np.array(own, dtype=np.float64)
    return image[..., :3], time.perf_counter() - start


@contextmanager
def silence():
    """Bars of progress, which one integrator draws whatever the level of its log, are of no use in a file."""
    sys.stdout.flush()
    kept, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(null)


def with_bdpm(path, size, seconds, seed, *options):
    """An image with no options but for how long, the seconds that it took with all that it prepares, its report."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "image.exr"
        command = [BDPM, "render", str(path), "--output", str(out), "--seed", str(seed), "--layers", "none", "--json"]
        command += ["--quiet", "--no-denoise", "--threads", str(THREADS), "--time", f"{seconds}s", *options]
        if size:
            command += ["--resolution", f"{size[0]}x{size[1]}"]
        start = time.perf_counter()
        run = subprocess.run(command, capture_output=True, text=True)
        seconds = time.perf_counter() - start
        if run.returncode != 0:
            sys.exit(f"{' '.join(command)}\n{run.stderr}")
        with OpenEXR.File(str(out), separate_channels=True) as file:
            channels = [file.channels()[name].pixels.astype(np.float64) for name in "RGB"]
        return np.stack(channels, axis=-1), seconds, json.loads(run.stdout)


def blocks(image):
    """Means over blocks of pixels."""
    height, width = (max(1, n // BLOCK) * min(n, BLOCK) for n in image.shape[:2])
    side = [min(n, BLOCK) for n in (height, width)]
    cut = image[:height, :width].reshape(height // side[0], side[0], width // side[1], side[1], 3)
    return cut.mean(axis=(1, 3))


class Series:
    """Independent images of one program."""

    def __init__(self, images):
        self.mean = np.mean(images, axis=0)
        means = np.array([image.mean(axis=(0, 1)) for image in images])
        parts = np.array([blocks(image) for image in images])
        count = len(images)
        self.channels, self.channel_error = means.mean(axis=0), means.std(axis=0, ddof=1) / count**0.5
        self.blocks, self.block_error = parts.mean(axis=0), parts.std(axis=0, ddof=1) / count**0.5
        # Luminance of the mean and its variance, per pixel.
        lit = np.array([luminance(image) for image in images])
        self.luminance, self.variance = lit.mean(axis=0), lit.var(axis=0, ddof=1) / count


def luminance(image):
    return image @ np.array([0.2126, 0.7152, 0.0722])


def compare(ours, theirs):
    """Ratio of means with its error, per channel, and z of each block."""
    ratio = ours.channels / theirs.channels
    error = ratio * np.hypot(ours.channel_error / ours.channels, theirs.channel_error / theirs.channels)
    spread = np.hypot(ours.block_error, theirs.block_error)
    # Few images tell errors of blocks badly: none is smaller than half of what is usual.
    spread = np.maximum(spread, 0.5 * np.median(spread))
    z = (ours.blocks - theirs.blocks) / np.maximum(spread, 1e-12)
    return ratio, error, z


class Reference:
    """The best mean of several series, and what is known of its own variance."""

    def __init__(self, *series):
        scale = self.floor(np.mean([one.luminance for one in series], axis=0))
        # One weight for the whole image: those of pixels would prefer images that missed rare light.
        weights = np.array([1 / np.mean(one.variance / scale) for one in series])
        self.weights = weights / weights.sum()
        self.luminance = sum(weight * one.luminance for weight, one in zip(self.weights, series))
        self.variance = sum(weight**2 * one.variance for weight, one in zip(self.weights, series))
        self.scale = self.floor(self.luminance)

    @staticmethod
    def floor(luminance):
        """As bdpm has it, docs/explanation/automatic.md: a hundredth of the squared mean is the least."""
        return luminance**2 + 0.01 * luminance.mean() ** 2

    def relative_mse(self, image):
        """Mean squared relative error of luminance, less what the reference's own noise adds to it."""
        return float(np.mean(((luminance(image) - self.luminance) ** 2 - self.variance) / self.scale))

    def own(self):
        return float(np.mean(self.variance / self.scale))


def shown(ratio, error):
    return " ".join(f"{r:.4f}±{e:.4f}" for r, e in zip(ratio, error))


def elements(only):
    """The small files, or only some of them, each within its tolerance."""
    seconds, runs = float(os.environ.get("SECONDS_EACH", 1.5)), int(os.environ.get("RUNS", 4))
    seeds = range(1, runs + 1)
    samples = round(170 * seconds)  # as long, about
    failed = []
    rows = [line.split("\t") for line in (ELEMENTS / "tolerances.tsv").read_text().splitlines()]
    print("| file | ratio of means, R G B | blocks: rms, largest z | tolerance |\n|---|---|---|---|")
    for name, tolerance, _, *kind in rows[1:]:
        if only and name not in only:
            continue
        path, tolerance = ELEMENTS / name, float(tolerance)
        scene = load(path)
        own = seconds * (LONGER_IN_MEDIA if kind else 1)
        ours = Series([with_bdpm(path, None, own, seed)[0] for seed in seeds])
        theirs = Series([with_mitsuba(scene, kind[0] if kind else "path", samples, seed)[0] for seed in seeds])
        ratio, error, z = compare(ours, theirs)
        rms = float(np.sqrt(np.mean(z**2)))
        print(f"| {name} | {shown(ratio, error)} | {rms:.1f}, {np.abs(z).max():.1f} | {tolerance} % |", flush=True)
        if (np.abs(ratio - 1) > tolerance / 100 + 4 * error).any():
            failed.append(name)
    if failed:
        sys.exit(f"beyond their tolerance: {', '.join(failed)}")


def samples_for(scene, kind, seconds):
    """Samples per pixel that take about so long."""
    with_mitsuba(scene, kind, 4, 1)  # what is compiled once does not count
    samples, took = 4, 0.0
    while took < 0.2 * seconds and samples < 1 << 14:
        samples *= 4
        _, took = with_mitsuba(scene, kind, samples, 1)
        _, took = with_mitsuba(scene, kind, samples, 2)
    return max(1, round(samples * seconds / took))


def whole(path, size, seconds, runs, long):
    """Agreement, and efficiencies at equal time in turn."""
    scene = load(path, size)
    size = tuple(int(n) for n in scene.sensors()[0].film().size())
    count = {kind: samples_for(scene, kind, seconds) for kind in ("path", "ptracer")}
    images, took, reports = {"path": [], "ptracer": [], "bdpm": []}, {}, []
    also = os.environ.get("ALSO", "")
    if also:
        images[f"bdpm {also}"] = []
    for seed in range(1, runs + 1):
        for kind in images:
            if kind.startswith("bdpm"):
                image, own, report = with_bdpm(path, size, seconds, seed, *kind.split()[1:])
                reports += [report] if kind == "bdpm" else []
            else:
                image, own = with_mitsuba(scene, kind, count[kind], seed)
            images[kind].append(image)
            took.setdefault(kind, []).append(own)
    # The bias is proportional to the square of the radii. At a third of them it is a ninth, so that the difference to
    # the reference is the bias of the runs.
    radii = {name: min(r["settings"][name] for r in reports) / 3 for name in ("radius", "caustic_radius")}
    options = ["--radius", str(radii["radius"]), "--caustic-radius", str(radii["caustic_radius"])]
    samples = max(1, round(count["path"] * long / (PARTS * seconds)))
    theirs = Series([with_mitsuba(scene, "path", samples, 100 + seed)[0] for seed in range(PARTS)])
    ours = Series([with_bdpm(path, size, long / PARTS, 100 + seed, *options)[0] for seed in range(PARTS)])
    ratio, error, z = compare(ours, theirs)
    agree = (np.abs(ratio - 1) < 0.005 + 3 * error).all()
    common = Reference(theirs, ours)
    references = {kind: common if agree else Reference(ours if kind.startswith("bdpm") else theirs) for kind in images}
    print(f"\n{path.parent.name}/{path.name} {size[0]}x{size[1]}, {THREADS} threads")
    print(f"  ratio of means (bdpm / path), R G B: {shown(ratio, error)}")
    over = 100 * np.mean(np.abs(z) > 3)
    print(f"  blocks of {BLOCK}x{BLOCK}: z rms {np.sqrt(np.mean(z**2)):.2f}, {over:.1f} % beyond 3")
    if agree:
        shares = ", ".join(f"{100 * w:.0f} % {name}" for w, name in zip(common.weights, ("path", "bdpm")))
        print(f"  reference: the mean of both, {shares}; its own relMSE {common.own():.1e}")
    else:
        print("  reference: of each program its own, for they do not agree")
    rows(images, took, references)
    settings = reports[-1]["settings"]
    chosen = [str(settings[name]) for name in ("strategy", "merge_vertex", "direct", "kernel")]
    print(f"  bdpm chose {' '.join(chosen)}, radii {settings['radius']:.3g} and {settings['caustic_radius']:.3g};", end="")
    print(f" it told {np.mean([r['error']['total'] ** 2 for r in reports]):.2e}", flush=True)


def rows(images, took, references):
    """The table of efficiencies, with the standard error of each error over the runs."""
    print("  | program | seconds | relMSE | efficiency | over path |\n  |---|---|---|---|---|")
    base = None
    for kind in images:
        errors = [references[kind].relative_mse(image) for image in images[kind]]
        mse, spread = np.mean(errors), np.std(errors, ddof=1) / len(errors) ** 0.5
        own = np.mean(took[kind])
        efficiency = 1 / (mse * own)
        base = base or efficiency
        row = f"{own:.2f} | {mse:.2e} ± {spread:.0e} | {efficiency:.3g} | {efficiency / base:.3g}"
        print(f"  | {kind} | {row} |", flush=True)


def main():
    of_elements = sys.argv[1:2] == ["--elements"]
    # Small scenes are not worth compiling.
    variant = start_mitsuba(("scalar_rgb",)) if of_elements else start_mitsuba()
    print(f"mitsuba {mi.__version__}, {variant}; {subprocess.getoutput(f'{BDPM} --version')}")
    if of_elements:
        return elements(sys.argv[2:])
    seconds, runs, long = (float(os.environ.get(name, value)) for name, value in DEFAULTS.items())
    sides = os.environ.get("SIZES", "128,own").split(",")
    sizes = [None if side == "own" else (int(side), int(side)) for side in sides]
    for size in sizes:
        for name in sys.argv[1:]:
            whole(Path(name), size, seconds, int(runs), long)


if __name__ == "__main__":
    main()
