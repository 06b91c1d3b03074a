"""Mitsuba and bdpm on the same files: how they agree, and what the same time buys. See mitsuba-check.sh."""

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import mitsuba as mi
import numpy as np
import OpenEXR

ROOT = Path(__file__).resolve().parent.parent
ELEMENTS = ROOT / "tests/data/mitsuba"
BDPM = os.environ["BDPM"]
THREADS = int(os.environ.get("THREADS", os.cpu_count()))
BLOCK = 16


def start_mitsuba(variants=("llvm_ad_rgb", "scalar_rgb")):
    """The first variant that runs here."""
    for variant in variants:
        try:
            mi.set_variant(variant)
            mi.set_log_level(mi.LogLevel.Error)
            if variant.startswith("llvm"):
                import drjit as dr

                dr.set_thread_count(max(1, THREADS - 1))  # the main thread works as well
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
    parameters = {}
    if size:
        for name, pixels in zip(("width", "height"), size):
            text = re.sub(rf'(<integer name="{name}" value=")[^"]*"', rf'\g<1>{pixels}"', text)
    mi.file_resolver().prepend(str(path.parent.resolve()))
    return mi.load_string(text, **parameters)


def with_mitsuba(scene, kind, samples, seed):
    """An image of so many samples per pixel, and the seconds that it took."""
    integrator = mi.load_dict({"type": kind, "max_depth": -1, "rr_depth": 5})
    start = time.perf_counter()
    image = np.array(mi.render(scene, integrator=integrator, spp=samples, seed=seed), dtype=np.float64)
    return image[..., :3], time.perf_counter() - start


def with_bdpm(path, size, seconds, seed, *options):
    """An image with no options but for how long, and the seconds that it took with all that it prepares."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "image.exr"
        command = [BDPM, "render", str(path), "--output", str(out), "--seed", str(seed)]
        command += ["--threads", str(THREADS), "--time", f"{seconds}s", *options]
        if size:
            command += ["--resolution", f"{size[0]}x{size[1]}"]
        start = time.perf_counter()
        run = subprocess.run(command, capture_output=True, text=True)
        seconds = time.perf_counter() - start
        if run.returncode != 0:
            sys.exit(f"{' '.join(command)}\n{run.stderr}")
        with OpenEXR.File(str(out), separate_channels=True) as file:
            channels = [file.channels()[name].pixels.astype(np.float64) for name in "RGB"]
        return np.stack(channels, axis=-1), seconds


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


def compare(ours, theirs):
    """Ratio of means with its error, per channel, z of each block, and the relative MSE of the mean images."""
    ratio = ours.channels / theirs.channels
    error = ratio * np.hypot(ours.channel_error / ours.channels, theirs.channel_error / theirs.channels)
    spread = np.hypot(ours.block_error, theirs.block_error)
    # Few images tell errors of blocks badly: none is smaller than half of what is usual.
    spread = np.maximum(spread, 0.5 * np.median(spread))
    z = (ours.blocks - theirs.blocks) / np.maximum(spread, 1e-12)
    return ratio, error, z, relative_mse(ours.mean, theirs.mean)


def relative_mse(image, reference):
    """As bdpm has it, docs/automatic.md: a hundredth of the squared mean is the least."""
    return float(np.mean((image - reference) ** 2 / (reference**2 + 0.01 * reference.mean() ** 2)))


def shown(ratio, error):
    return " ".join(f"{r:.4f}±{e:.4f}" for r, e in zip(ratio, error))


def elements():
    """The small files, each within its tolerance."""
    failed = []
    rows = [line.split("\t") for line in (ELEMENTS / "tolerances.tsv").read_text().splitlines()]
    print("| file | ratio of means, R G B | blocks: rms, largest z | tolerance |\n|---|---|---|---|")
    for name, tolerance, *_ in rows[1:]:
        path, tolerance = ELEMENTS / name, float(tolerance)
        scene = load(path)
        size = scene.sensors()[0].film().size()
        ours = Series([with_bdpm(path, None, 0.6, seed)[0] for seed in range(1, 5)])
        theirs = Series([with_mitsuba(scene, "path", 256, seed)[0] for seed in range(1, 5)])
        ratio, error, z, _ = compare(ours, theirs)
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


def whole(path, size, seconds, runs):
    """Agreement, and efficiencies at equal time in turn."""
    scene = load(path, size)
    film = scene.sensors()[0].film().size()
    size = (int(film[0]), int(film[1]))
    count = {kind: samples_for(scene, kind, seconds) for kind in ("path", "ptracer")}
    images = {"path": [], "ptracer": [], "bdpm": []}
    took = {kind: [] for kind in images}
    for seed in range(1, runs + 1):
        for kind in images:
            if kind == "bdpm":
                image, own = with_bdpm(path, size, seconds, seed)
            else:
                image, own = with_mitsuba(scene, kind, count[kind], seed)
            images[kind].append(image)
            took[kind].append(own)
    long_path = [with_mitsuba(scene, "path", 4 * count["path"], 100 + seed)[0] for seed in range(4)]
    long_bdpm = [with_bdpm(path, size, 4 * seconds, 100 + seed)[0] for seed in range(4)]
    theirs, ours = Series(long_path), Series(long_bdpm)
    ratio, error, z, mse = compare(ours, theirs)
    print(f"\n{path.parent.name}/{path.name} {size[0]}x{size[1]}, {THREADS} threads")
    print(f"  ratio of means (bdpm / path), R G B: {shown(ratio, error)}")
    over = 100 * np.mean(np.abs(z) > 3)
    print(f"  blocks of {BLOCK}x{BLOCK}: z rms {np.sqrt(np.mean(z**2)):.2f}, {over:.1f} % beyond 3; relMSE {mse:.2e}")
    agree = (np.abs(ratio - 1) < 0.005 + 3 * error).all()
    common = 0.5 * (ours.mean + theirs.mean)
    print(f"  reference: {'the mean of both' if agree else 'of each program its own: they do not agree'}")
    print("  | program | seconds | relMSE | efficiency | over path |\n  |---|---|---|---|---|")
    base = None
    for kind in images:
        reference = common if agree else (ours if kind == "bdpm" else theirs).mean
        mse = float(np.mean([relative_mse(image, reference) for image in images[kind]]))
        own = float(np.mean(took[kind]))
        efficiency = 1 / (mse * own)
        base = base or efficiency
        print(f"  | {kind} | {own:.2f} | {mse:.2e} | {efficiency:.3g} | {efficiency / base:.2f} |", flush=True)


def main():
    of_elements = sys.argv[1:] == ["--elements"]
    # Small scenes are not worth compiling, and an environment map was seen to wait forever in the other variant.
    variant = start_mitsuba(("scalar_rgb",)) if of_elements else start_mitsuba()
    print(f"mitsuba {mi.__version__}, {variant}; {subprocess.getoutput(f'{BDPM} --version')}")
    if of_elements:
        return elements()
    seconds, runs = float(os.environ.get("SECONDS_EACH", 10)), int(os.environ.get("RUNS", 4))
    sizes = [(128, 128), None] if "SMALL" not in os.environ else [(128, 128)]
    for name in sys.argv[1:]:
        for size in sizes:
            whole(Path(name), size, seconds, runs)


main()
