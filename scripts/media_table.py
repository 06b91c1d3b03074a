#!/usr/bin/env python3
"""Measures bdpm and Mitsuba's `volpath` on scenes/media, and prints the tables of docs/measurements/media.md.

usage: media_table.py [--bdpm PROGRAM] [--folder FOLDER] [--seconds S] [--runs N] [--long S] [SCENE...]
       media_table.py --images [--bdpm PROGRAM] [--folder FOLDER] [--seconds S] [--size N] [SCENE...]

Both programs render 128x128 pixels (--size) on all processors: --runs images of --seconds each, and four parts of a long
render of together --long seconds. bdpm gets nothing but a time. The number of samples of `volpath` is that which takes
as long, after a first render that compiles its kernels. Where paths hardly ever hit the small lamp of a scene, the means
of `volpath` say little. There, means are those of four more parts with a wide lamp.

Images are kept in --folder: a run that was interrupted goes on where it ended, and scenes that are rendered already are
only evaluated. Remove the folder of a program to measure it again. With --images, only the first run of each scene is
rendered, and written as FOLDER/SCENE-PROGRAM.exr. Wants Mitsuba, numpy and OpenEXR, as
mitsuba-check.sh installs them.
"""

import argparse
import json
import os
import re
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
SCENES = ("wine", "fog", "milk", "smoke", "underwater")
# Values of the file's parameters with which paths hit the lamp.
WIDE = {"smoke": {"lamp": "0.3", "tube": "0.33"}, "underwater": {"lamp": "1"}}
WORST = 0.001  # share of pixels that the last column leaves out


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bdpm", default=str(ROOT / "target/release/bdpm"))
    parser.add_argument("--folder", type=Path, default=ROOT / "target/media-table")
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--long", type=float, default=80)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--images", action="store_true")
    parser.add_argument("scenes", nargs="*", default=SCENES)
    return parser.parse_args()


class Kept:
    """Images of a scene by one program, on disk."""

    def __init__(self, folder, render):
        self.folder, self.render = folder, render
        folder.mkdir(parents=True, exist_ok=True)

    def image(self, name, *how):
        """The image of this name with its seconds and notes, which is rendered if it is missing."""
        path = self.folder / f"{name}.npz"
        if not path.exists():
            image, seconds, notes = self.render(*how)
            part = path.with_suffix(".part.npz")
            np.savez(part, image=image.astype(np.float32), seconds=seconds, notes=json.dumps(notes))
            part.rename(path)
        with np.load(path) as kept:
            return kept["image"].astype(np.float64), float(kept["seconds"]), json.loads(str(kept["notes"]))


class Volpath:
    """Mitsuba, which reads a scene and compiles its kernels only if an image is missing."""

    def __init__(self, path, size, seconds):
        self.path, self.size, self.seconds, self.scene = path, size, seconds, None

    def __call__(self, seconds, seed):
        if self.scene is None:
            self.scene = mc.load(self.path, self.size)
            self.samples = mc.samples_for(self.scene, "volpath", self.seconds)
        samples = max(1, round(self.samples * seconds / self.seconds))
        image, took = mc.with_mitsuba(self.scene, "volpath", samples, seed)
        return image, took, {"samples": samples}


def kept(options, name, path):
    """The images of a file by both programs."""
    size = (options.size, options.size)

    def ours(seconds, seed):
        image, took, report = mc.with_bdpm(path, size, seconds, seed)
        keys = ("strategy", "merge_vertex", "direct", "radius", "caustic_radius")
        return image, took, {key: report["settings"][key] for key in keys} | {"error": report["error"]}

    return {
        "bdpm": Kept(options.folder / "bdpm" / name, ours),
        "volpath": Kept(options.folder / "volpath" / name, Volpath(path, size, options.seconds)),
    }


def widened(options, name):
    """The file of a scene with its wide lamp, which refers to its meshes from another folder."""
    folder = ROOT / "scenes/media"
    text = (folder / f"{name}.xml").read_text()
    for key, value in WIDE[name].items():
        text, count = re.subn(rf'(<default name="{key}" value=)"[^"]*"', rf'\1"{value}"', text)
        if count != 1:
            sys.exit(f"{name}.xml has no parameter {key}")
    text = re.sub(r'(<string name="filename" value=")', rf"\1{folder}/", text)
    path = options.folder / f"{name}-wide.xml"
    path.write_text(text)
    return path


def measured(options, name):
    """The images of a scene by both programs: runs, parts of the long render, and those whose means are compared."""
    options.folder.mkdir(parents=True, exist_ok=True)
    images = kept(options, name, ROOT / "scenes/media" / f"{name}.xml")
    seeds = range(1, options.runs + 1)
    runs = {kind: [own.image(f"run{seed}", options.seconds, seed) for seed in seeds] for kind, own in images.items()}

    def parts(images):
        each = options.long / mc.PARTS
        part = lambda own: [own.image(f"long{part}", each, 100 + part) for part in range(mc.PARTS)]
        return {kind: part(own) for kind, own in images.items()}

    long = parts(images)
    wide = parts(kept(options, f"{name}-wide", widened(options, name))) if name in WIDE else long
    return runs, *({kind: [image for image, _, _ in own] for kind, own in all.items()} for all in (long, wide))


def mean(images):
    """Mean luminance of images and its standard error."""
    means = np.array([mc.luminance(image).mean() for image in images])
    return means.mean(), means.std(ddof=1) / len(means) ** 0.5


def errors(reference, image):
    """Mean squared relative error, of all pixels and without the worst ones."""
    squares = ((mc.luminance(image) - reference.luminance) ** 2 - reference.variance) / reference.scale
    squares = np.sort(squares.ravel())
    return squares.mean(), squares[: len(squares) - round(WORST * len(squares))].mean()


def evaluated(name, runs, long, wide):
    """The rows of a scene in both tables."""
    means = {kind: mean(images) for kind, images in wide.items()}
    (ours, our_error), (theirs, their_error) = means["bdpm"], means["volpath"]
    ratio = ours / theirs
    error = ratio * np.hypot(our_error / ours, their_error / theirs)
    both = [mc.luminance(np.mean(wide[kind], axis=0)) for kind in ("bdpm", "volpath")]
    off = np.median(abs(both[0] / both[1] - 1))
    label = f"{name}, wide lamp" if name in WIDE else name
    agreement = f"| {label} | {ours:.5g} ± {our_error:.2g} | {theirs:.5g} ± {their_error:.2g} | {ratio:.4f} ± {error:.4f} | {off:.3f} |"
    kinds = ("bdpm",) if name in WIDE else ("bdpm", "volpath")
    reference = mc.Reference(*(mc.Series(long[kind]) for kind in kinds))
    shares = " and ".join(f"{100 * w:.0f} % {kind}" for w, kind in zip(reference.weights, kinds))
    print(f"{name}: reference {shares}, its own relMSE {reference.own():.1e}", file=sys.stderr)
    rows, cost = [], {}
    for kind in ("volpath", "bdpm"):
        own = np.array([errors(reference, image) for image, _, _ in runs[kind]])
        seconds = np.mean([run[1] for run in runs[kind]])
        cost[kind] = own.mean(axis=0) * seconds
        over, over_most = cost["volpath"] / cost[kind]
        label = name if kind == "volpath" else ""
        each = " ".join(f"{e:.2e}" for e in own[:, 0])
        rows.append(f"| {label} | `{kind}` | {seconds:.1f} | {each} | {own[:, 1].mean():.2e} | {over:.3g} | {over_most:.3g} |")
    notes = runs["bdpm"][0][2]
    print(f"{name}: bdpm chose {notes}; volpath: {runs['volpath'][0][2]['samples']} samples per pixel", file=sys.stderr)
    return agreement, rows


def write_images(options):
    """Writes the first run of each scene by each program."""
    for name in options.scenes:
        for kind, own in kept(options, name, ROOT / "scenes/media" / f"{name}.xml").items():
            image, seconds, _ = own.image("run1", options.seconds, 1)
            channels = {channel: image[..., i].astype(np.float32) for i, channel in enumerate("RGB")}
            with mc.OpenEXR.File({"type": mc.OpenEXR.scanlineimage}, channels) as file:
                file.write(str(options.folder / f"{name}-{kind}.exr"))
            print(f"{name}, {kind}: {seconds:.1f} s")


def main():
    if options.images:
        return write_images(options)
    tables = [evaluated(name, *measured(options, name)) for name in options.scenes]
    print("| scene | mean, bdpm | mean, volpath | ratio | pixels: median |")
    print("|---|---|---|---|---|")
    print("\n".join(agreement for agreement, _ in tables))
    print("\n| scene | | seconds | relMSE | without the worst .1 % | over volpath | without the worst .1 % |")
    print("|---|---|---|---|---|---|---|")
    print("\n".join(row for _, rows in tables for row in rows))


options = arguments()
# The module takes the program from its environment.
os.environ["BDPM"] = options.bdpm
import mitsuba_check as mc  # noqa: E402

print(f"mitsuba {mc.mi.__version__}, {mc.start_mitsuba()}, {mc.THREADS} threads; {options.bdpm}", file=sys.stderr)
main()
