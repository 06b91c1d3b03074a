#!/usr/bin/env python3
"""Light that the cache of `gather` adds or lacks beside `path`, as the rows of a table.

usage: cache_means.py [--bdpm PROGRAM] [--time S] [--runs N] [--square PIXELS] [--picture FILE.png] SCENE@WxH...

Wants OpenEXR and Pillow (`pip install OpenEXR Pillow numpy`). SCENE is any scene that bdpm renders, in WxH pixels. Both strategies get
the same time in --runs images of each. The column "mean" is the mean luminance of `gather` over that of `path`, with the
standard error by the `rms` layers of all images. The column "squares" is the root of the mean squared relative
difference of squares of --square pixels, without the noise by the differences of the runs; the column "worst" is the
largest relative difference of a square, in standard errors of that difference by the runs, and where it is.

--picture shows, for the last scene, `path`, `gather` and their difference: a gray of one half is none, black and white
are -20 % and 20 % of the luminance of `path` around.
"""

import argparse
import pathlib
import subprocess
import tempfile

import numpy as np
import OpenEXR
from PIL import Image

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
SHOWN = 0.2


def render(options, scene, size, strategy, seed, folder):
    """The luminance of an image, and its standard error in each pixel."""
    out = pathlib.Path(folder) / "image.exr"
    command = [options.bdpm, "render", str(scene), "--output", str(out), "--time", f"{options.time}s", "--strategy", strategy]
    command += ["--seed", str(seed), "--resolution", size]
    subprocess.run([*command, "--no-denoise", "--quiet"], check=True, capture_output=True)
    with OpenEXR.File(str(out), separate_channels=True) as file:
        channels = file.channels()
        rgb = np.stack([channels[c].pixels for c in "RGB"], axis=-1)
        return rgb.astype(np.float64) @ LUMINANCE, channels["rms.Y"].pixels.astype(np.float64)


def squares(image, side):
    height, width = (length // side * side for length in image.shape)
    return image[:height, :width].reshape(height // side, side, width // side, side).mean(axis=(1, 3))


def around(image, radius):
    """Means over squares around each pixel."""
    padded = np.pad(image, radius + 1, mode="edge").cumsum(axis=0).cumsum(axis=1)
    side = 2 * radius + 1
    sums = padded[side:, side:] - padded[:-side, side:] - padded[side:, :-side] + padded[:-side, :-side]
    return sums[: image.shape[0], : image.shape[1]] / side**2


def row(options, scene, images):
    """Cells of the table. `images` has those of `path` and of `gather`, each with its errors."""
    means, errors = ([np.mean([own[part] for own in runs], axis=0) for runs in images] for part in (0, 1))
    relative = [np.sqrt((error**2).sum() / options.runs) / mean.sum() for error, mean in zip(errors, means)]
    path, gather = ([squares(own[0], options.square) for own in runs] for runs in images)
    reference = np.mean(path, axis=0)
    difference = np.mean(gather, axis=0) - reference
    variance = sum(np.var(own, axis=0, ddof=1) / options.runs for own in (path, gather))
    weights = 1 / (reference**2 + 0.01 * reference.mean() ** 2)
    square = float((weights * (difference**2 - variance)).mean())
    # Two runs hardly tell the error of their square: that of the squares around counts, too.
    spread = np.sqrt(around(weights * variance, 2) / weights)
    worst = np.unravel_index(np.argmax(np.abs(difference) / spread), difference.shape)
    place = "{},{}".format(*(options.square * index for index in worst[::-1]))
    root = np.sign(square) * abs(square) ** 0.5
    name = scene.parent.name if scene.suffix == ".xml" else scene.stem
    return (
        f"| {name} | {means[1].mean() / means[0].mean():.4f} ± {np.hypot(*relative):.4f} | {100 * root:.1f} % "
        f"| {100 * difference[worst] / reference[worst]:+.1f} % ({difference[worst] / spread[worst]:+.1f}) at {place} |"
    )


def picture(options, images):
    path, gather = (np.mean([own[0] for own in runs], axis=0) for runs in images)
    white = np.quantile(path, 0.97)
    shown = [np.clip(image / white, 0, 1) ** (1 / 2.2) for image in (path, gather)]
    difference = around(gather - path, 4) / np.maximum(around(path, 4), 0.02 * path.mean())
    shown.append(np.clip(0.5 + 0.5 * difference / SHOWN, 0, 1))
    Image.fromarray((255 * np.concatenate(shown, axis=1)).astype(np.uint8)).save(options.picture)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bdpm", default="target/release/bdpm")
    parser.add_argument("--time", type=float, default=30)
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--square", type=int, default=16)
    parser.add_argument("--picture", type=pathlib.Path)
    parser.add_argument("scenes", nargs="+", metavar="SCENE@WxH")
    options = parser.parse_args()
    print("| scene | mean | squares | worst |\n|---|---|---|---|")
    for asked in options.scenes:
        scene, size = asked.rsplit("@", 1)
        scene = pathlib.Path(scene)
        with tempfile.TemporaryDirectory() as folder:
            images = [
                [render(options, scene, size, strategy, first + run, folder) for run in range(options.runs)]
                for first, strategy in ((1, "path"), (101, "gather"))
            ]
        print(row(options, scene, images), flush=True)
    if options.picture:
        picture(options, images)


if __name__ == "__main__":
    main()
