#!/usr/bin/env python3
"""Equal-time errors of bdpm without options and of Mitsuba's path tracer, as the rows of a table.

usage: interiors.py [--bdpm PROGRAM] [--time S] [--threads N] [--runs N] [--reference S] [--width W] SCENE.xml...

Wants Mitsuba 3 and OpenEXR (`pip install mitsuba OpenEXR numpy`). SCENE.xml is any scene that Mitsuba reads. The
reference of a scene is made once, by `path` in 8 parts of together --reference seconds, and kept beside it in
SCENE.reference-W.npz. Its own error is estimated by the spread of the parts, and subtracted from that of the images.

The error is the mean over pixels of (L - R)^2/(R^2 + 0.01 mean(R)^2) of the luminance. Seconds of Mitsuba are those of
rendering alone, after its kernels are compiled; those of bdpm are all but reading the scene and writing the image.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile
import time

import mitsuba_paths
import numpy as np
import OpenEXR

PARTS = 8


def luminance(image):
    return np.asarray(image, dtype=np.float64) @ np.array([0.2126, 0.7152, 0.0722])


class PathTracer(mitsuba_paths.PathTracer):
    """With images of any number of samples, and their times."""

    def __init__(self, path, width, threads):
        super().__init__(path, width, threads)
        self.per_second = self.samples / self.render(self.samples, 1)[1]

    def render(self, samples, seed):
        """The luminance at about so many samples per pixel, in whole passes, and the seconds that it took."""
        passes = max(1, round(samples / self.samples))
        image, start = 0.0, time.perf_counter()
        for number in range(passes):
            one = self.render_pass((seed << 14) + number)
            image = image + luminance(one[..., :3]) / passes
        return image, time.perf_counter() - start


class Reference:
    def __init__(self, path, tracer, seconds, width=None):
        file = path.with_suffix(f".reference-{width or tracer.size[0]}.npz")
        if not file.exists():
            samples = tracer.per_second * seconds / PARTS
            parts = [tracer.render(samples, 100 + part)[0] for part in range(PARTS)]
            np.savez(file, parts=np.array(parts))
        parts = np.load(file)["parts"]
        self.image = parts.mean(axis=0)
        self.scale = self.image**2 + 0.01 * self.image.mean() ** 2
        self.own = float((parts.var(axis=0, ddof=1) / len(parts) / self.scale).mean())

    def error(self, image):
        return float(((image - self.image) ** 2 / self.scale).mean()) - self.own


def read_luminance(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        return luminance(np.stack([channels[c].pixels for c in "RGB"], axis=-1))


def render_bdpm(options, path, size, seed):
    """The image, the seconds without reading and writing, and the result."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "image.exr"
        command = [options.bdpm, "render", str(path), "--output", str(out), "--time", f"{options.time}s"]
        command += ["--threads", str(options.threads), "--seed", str(seed), "--resolution", "{}x{}".format(*size)]
        command += ["--layers", "none", "--no-denoise", "--json", "--quiet"]
        start = time.perf_counter()
        run = subprocess.run(command, capture_output=True, text=True, check=True)
        seconds = time.perf_counter() - start
        result = json.loads(run.stdout)
        return read_luminance(out), seconds - result["seconds"]["load"] - result["seconds"]["write"], result


def mean(values):
    """Mean with its standard error."""
    values = np.array(values)
    error = values.std(ddof=1) / len(values) ** 0.5 if len(values) > 1 else float("nan")
    return values.mean(), error


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bdpm", default="target/release/bdpm")
    parser.add_argument("--time", type=float, default=20)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--reference", type=float, default=240)
    parser.add_argument("--width", type=int, default=160)
    parser.add_argument("scenes", nargs="+", type=pathlib.Path)
    options = parser.parse_args()
    print("| scene | relMSE of `path` | relMSE of `bdpm` | its report | mean | over path | chosen |\n|---|---|---|---|---|---|---|")
    for path in options.scenes:
        tracer = PathTracer(path, options.width, options.threads)
        reference = Reference(path, tracer, options.reference)
        samples = tracer.per_second * options.time
        traced = [tracer.render(samples, 200 + run) for run in range(options.runs)]
        rendered = [render_bdpm(options, path, tracer.size, 1 + run) for run in range(options.runs)]
        rows = [mean([reference.error(image) for image, *_ in images]) for images in (traced, rendered)]
        seconds = [np.mean([one[1] for one in images]) for images in (traced, rendered)]
        results = [result for *_, result in rendered]
        report = np.mean([result["error"]["total"] ** 2 for result in results])
        ratio = np.mean([image.mean() for image, *_ in rendered]) / reference.image.mean()
        gain = rows[0][0] * seconds[0] / (rows[1][0] * seconds[1])
        chosen = ", ".join(sorted({result["settings"]["strategy"] for result in results}))
        cells = ["{:.2e} ± {:.0e}".format(*row) for row in rows]
        print(f"| {path.parent.name or path.stem} | {cells[0]} | {cells[1]} | {report:.2e} | {ratio:.4f} | {gain:.2g} | `{chosen}` |", flush=True)


if __name__ == "__main__":
    main()
