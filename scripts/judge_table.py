#!/usr/bin/env python3
"""How often `bdpm compare --scene` calls right images wrong and finds planted errors, as rows of a table.

usage: judge_table.py [--bdpm PROGRAM] [--images N] [--time S] [--threads N] [SCENE...]

Wants OpenEXR and numpy (`pip install OpenEXR numpy`). Of each scene, N pairs of images are rendered by path tracing
with seeds of their own. Each pair is judged as it is. Of every fifth pair, copies with a planted error are judged,
too: all values .5 % or 2 % brighter, the quarter in the middle 5 % brighter, moved right by half a pixel, mirrored.
Every judgment has a seed of its own and at most --time seconds.
"""

import argparse
import collections
import json
import pathlib
import subprocess
import tempfile

import numpy as np
import OpenEXR

SIZE = (64, 48)
PATHS = ["--strategy", "path", "--iterations", "64", "--light-paths", "2", "--camera-paths", "4"]


def read(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return np.stack([file.channels()[c].pixels for c in "RGB"], axis=-1).astype(np.float32)


def write(path, image):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {c: np.ascontiguousarray(image[..., i]) for i, c in enumerate("RGB")}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def in_the_middle(image):
    height, width = image.shape[:2]
    changed = image.copy()
    changed[height // 4 : 3 * height // 4, width // 4 : 3 * width // 4] *= 1.05
    return changed


PLANTED = {
    "all values .5 % brighter": lambda image: image * np.float32(1.005),
    "all values 2 % brighter": lambda image: image * np.float32(1.02),
    "a quarter of the image 5 % brighter": in_the_middle,
    "moved by half a pixel": lambda image: 0.5 * (image + np.roll(image, 1, axis=1)),
    "mirrored": lambda image: image[:, ::-1],
}


NAMES = ["right", *PLANTED]


def row(name, scene, verdicts):
    cells = [str(verdicts[verdict]) for verdict in ("wrong", "right", "undecided")]
    print(f"| {name} | {pathlib.Path(scene).name} | {sum(verdicts.values())} | {' | '.join(cells)} |", flush=True)


def run(options, *arguments):
    command = [options.bdpm, *map(str, arguments), "--threads", str(options.threads), "--json"]
    # The status says what the verdict is, too
    run = subprocess.run(command, capture_output=True, text=True)
    if not run.stdout:
        raise SystemExit(run.stderr)
    return json.loads(run.stdout)


def judge(options, images, scene, seed):
    arguments = ["compare", *images, "--scene", scene, "--time", f"{options.time}s", "--seed", seed]
    return run(options, *arguments)["verdict"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bdpm", default="target/release/bdpm")
    parser.add_argument("--images", type=int, default=40)
    parser.add_argument("--time", type=float, default=3)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("scenes", nargs="*")
    options = parser.parse_args()
    scenes = options.scenes or ["scenes/cornell-box", "scenes/caustic-sphere", "scenes/office", "scenes/daylight", "scenes/keyhole"]
    verdicts = collections.defaultdict(collections.Counter)
    print("| images | scene | judged | wrong | right | undecided |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for scene in scenes:
            for number in range(options.images):
                pair = [folder / "first.exr", folder / "second.exr"]
                for which, path in enumerate(pair):
                    size = ["--resolution", "{}x{}".format(*SIZE), "--seed", 1000 + 2 * number + which]
                    run(options, "render", scene, "--output", path, "--quiet", "--layers", "none", *PATHS, *size)
                verdicts["right", scene][judge(options, pair, scene, number + 1)] += 1
                for name, plant in PLANTED.items() if number % 5 == 0 else ():
                    planted = [folder / "planted-1.exr", folder / "planted-2.exr"]
                    for path, changed in zip(pair, planted):
                        write(changed, plant(read(path)))
                    verdicts[name, scene][judge(options, planted, scene, number + 1)] += 1
            for name in NAMES:
                row(name, scene, verdicts[name, scene])
    for name in NAMES:
        row(name, "all", sum((verdicts[name, scene] for scene in scenes), collections.Counter()))


if __name__ == "__main__":
    main()
