#!/usr/bin/env python3
"""Loads public scenes with bdpm and with Mitsuba, and compares the means of their images, as the rows of a table.

usage: public_scenes.py [--bdpm PROGRAM] [--load] [--spp N] [--iterations N] [--width W] [--tolerance X] SCENE...

Wants Mitsuba 3, numpy and OpenEXR. SCENE is a file of Mitsuba (.xml), or OURS=JUDGE: bdpm renders the first file, of any
format, and Mitsuba the second one, which shows the same scene. With --load, every file is loaded only, and rendered
briefly by bdpm.

Mitsuba renders with `path`, without a limit of depth and with a box filter, in 4 parts of together --spp samples per
pixel. bdpm renders with `--strategy path` in 4 parts, too. Errors are standard errors by the differences of the parts
in each pixel. Properties that Mitsuba does not know are ignored instead of refused. Fails if a mean of the luminance is
off by more than --tolerance percent and by more than 3 standard errors.
"""

import argparse
import pathlib
import re
import subprocess
import sys
import tempfile

import numpy as np

PARTS = 4


def luminance(image):
    return np.asarray(image, dtype=np.float64) @ np.array([0.2126, 0.7152, 0.0722])


class Judge:
    """Mitsuba, by compiled kernels if its LLVM is recent enough."""

    def __init__(self):
        import drjit
        import mitsuba

        self.mi, self.dr = mitsuba, drjit
        for variant in ("llvm_ad_rgb", "scalar_rgb"):
            try:
                mitsuba.set_variant(variant)
                mitsuba.set_log_level(mitsuba.LogLevel.Error)
                # With one thread, reading an environment map waits forever
                drjit.set_thread_count(2)
                box = mitsuba.load_dict(mitsuba.cornell_box())
                drjit.eval(mitsuba.render(box, spp=1))
                self.variant = variant
                return
            except Exception as problem:
                print(f"mitsuba: {variant}: {str(problem).splitlines()[0]}", file=sys.stderr)
        sys.exit("mitsuba: no variant runs")

    def load(self, path, width=None):
        """The scene, whose film is `width` pixels wide."""
        mi = self.mi
        text = path.read_text(errors="replace")
        # Integrators of other versions are unknown; `path` is given on its own
        text = re.sub(r"<integrator\b[^>]*/>", "", text)
        text = re.sub(r"<integrator\b.*?</integrator>", "", text, flags=re.S)
        # The filter of 0.6
        text = text.replace('value="trilinear"', 'value="bilinear"').replace('value="ewa"', 'value="bilinear"')
        text = re.sub(r'(<rfilter\s+type=")\w+"', r'\1box"', text)
        config = mi.parser.ParserConfig(self.variant)
        config.unused_properties = mi.LogLevel.Debug
        config.unused_parameters = mi.LogLevel.Debug
        mi.file_resolver().prepend(str(path.parent.resolve()))
        with tempfile.NamedTemporaryFile("w", suffix=".xml", dir=path.parent) as copy:
            copy.write(text)
            copy.flush()
            state = mi.parser.parse_file(config, copy.name)
            mi.parser.transform_all(config, state)
            scene = mi.parser.instantiate(config, state)
        scene = scene[0] if isinstance(scene, list) else scene
        if width:
            film = mi.traverse(scene.sensors()[0])
            w, h = film["film.size"]
            film["film.size"] = [width, round(width * h / w)]
            film.update()
        return scene

    def parts(self, scene, spp):
        integrator = self.mi.load_dict({"type": "path", "max_depth": -1, "rr_depth": 8})
        passes = max(1, spp // (16 * PARTS))
        images = []
        for part in range(PARTS):
            image = 0.0
            for step in range(passes):
                seed = part * passes + step
                one = self.mi.render(scene, integrator=integrator, spp=16, seed=seed)
                image = image + np.array(one, dtype=np.float64)[..., :3] / passes
            images.append(image)
        return np.array(images)


def render(options, path, size, iterations, seed):
    import OpenEXR

    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "image.exr"
        command = [options.bdpm, "render", str(path), "--output", str(out), "--strategy", "path", "--quiet"]
        command += ["--iterations", str(iterations), "--seed", str(seed), "--layers", "none"]
        command += ["--resolution", "{}x{}".format(*size)]
        run = subprocess.run(command, capture_output=True, text=True)
        if run.returncode != 0:
            raise RuntimeError(run.stderr.splitlines()[0])
        with OpenEXR.File(str(out), separate_channels=True) as file:
            return np.stack([file.channels()[c].pixels.astype(np.float64) for c in "RGB"], axis=-1)


def mean(parts):
    """Mean of the luminance and its standard error, by the variance of each pixel over the parts."""
    lit = luminance(parts)
    return lit.mean(), (lit.var(axis=0, ddof=1).sum() / len(lit)) ** 0.5 / lit[0].size


def compare(options, judge, ours, theirs):
    """The row of a scene, and whether it is within the tolerance."""
    name = f"{ours.parent.name}/{ours.name}"
    try:
        scene = judge.load(theirs, options.width)
        size = tuple(int(n) for n in scene.sensors()[0].film().size())
        expected = judge.parts(scene, options.spp)
    except Exception as problem:
        return f"| {name} | Mitsuba: {' '.join(str(problem).split())[-120:]} | | | |", True
    try:
        images = np.array([render(options, ours, size, options.iterations, seed) for seed in range(PARTS)])
    except RuntimeError as problem:
        return f"| {name} | bdpm: {problem} | | | |", False
    (a, da), (b, db) = mean(images), mean(expected)
    ratio = a / b
    error = ratio * np.hypot(da / a, db / b)
    blocks = [block_means(luminance(parts)) for parts in (images, expected)]
    floor = 0.02 * b
    off = np.abs(blocks[0].mean(axis=0) - blocks[1].mean(axis=0)) / (blocks[1].mean(axis=0) + floor)
    row = f"| {name} | {size[0]}x{size[1]} | {ratio:.4f} ± {error:.4f} | {np.median(off):.4f} | {off.max():.3f} |"
    return row, abs(ratio - 1) < options.tolerance / 100 + 3 * error


def block_means(lit, side=16):
    count, height, width = lit.shape
    h, w = max(1, height // side), max(1, width // side)
    cut = lit[:, : h * (height // h), : w * (width // w)]
    return cut.reshape(count, h, height // h, w, width // w).mean(axis=(2, 4))


def load(options, judge, path):
    """Whether both programs load a file."""
    try:
        size, theirs = [64, 48], "renders"
        if path.suffix == ".xml":
            judge.load(path)
    except Exception as problem:
        theirs = "refuses: " + " ".join(str(problem).split())[-80:]
    try:
        render(options, path, size, 1, 1)
        ours = "renders"
    except RuntimeError as problem:
        ours = str(problem)
    print(f"| {path.parent.name}/{path.name} | {ours} | {theirs if path.suffix == '.xml' else ''} |", flush=True)
    return ours == "renders" or theirs != "renders"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bdpm", default="target/release/bdpm")
    parser.add_argument("--load", action="store_true")
    parser.add_argument("--spp", type=int, default=1024)
    parser.add_argument("--iterations", type=int, default=256)
    parser.add_argument("--width", type=int, default=128)
    parser.add_argument("--tolerance", type=float, default=0.5)
    parser.add_argument("scenes", nargs="+")
    options = parser.parse_args()
    judge = Judge()
    failed = []
    heads = ("| file | bdpm | Mitsuba |\n|---|---|---|", "| scene | size | bdpm/Mitsuba | blocks: median | largest |\n|---|---|---|---|---|")
    print(heads[0] if options.load else heads[1], flush=True)
    for scene in options.scenes:
        ours, _, theirs = scene.partition("=")
        if options.load:
            is_well = load(options, judge, pathlib.Path(ours))
        else:
            row, is_well = compare(options, judge, pathlib.Path(ours), pathlib.Path(theirs or ours))
            print(row, flush=True)
        if not is_well:
            failed.append(scene)
    if failed:
        sys.exit(f"not within the tolerance: {', '.join(failed)}")


main()
