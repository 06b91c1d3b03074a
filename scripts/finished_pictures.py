#!/usr/bin/env python3
"""Equal-time errors of denoised images of bdpm and of Mitsuba's path tracer, as the rows of a table.

usage: finished_pictures.py [--bdpm PROGRAM] [--times S,S,...] [--threads N] [--runs N] [--width W] [--reference SECONDS]
           [--keep FOLDER] SCENE.xml...

Wants Mitsuba 3 and OpenEXR (`pip install mitsuba OpenEXR numpy`), and references that `interiors.py --width 320` has
made. bdpm renders with --denoise and no other option. Mitsuba's image, with albedo and normals, is denoised by
`bdpm denoise`: the same Open Image Denoise. The time of Mitsuba is that of its path tracer alone: compiling kernels,
the 16 samples of albedo and normals, and denoising do not count. That of bdpm includes its pilot and denoising.

The error is the root of the mean over pixels of (L - R)^2/(M^2 + 0.01 mean(M)^2) of the luminance. Each program has
references of its own, R: scenes differ where programs read them in other ways, such as a map that is interpolated or
not. Products of different parts of a reference, (L - R1)(L - R2), do not have its noise. M is the mean of the denoised
images, so that weights do not follow that noise either. The column "scenes" is the error between the references. Images
that are wider than the reference are first averaged over squares of pixels.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile

import interiors
import mitsuba
import numpy as np
import OpenEXR

REFERENCE_WIDTH = 320
OWN_PARTS = 2


class Denoised:
    """Denoised images of Mitsuba, by the denoiser of bdpm."""

    def __init__(self, options, tracer):
        self.options, self.tracer = options, tracer
        aovs = {"type": "aov", "aovs": "albedo:albedo,normal:sh_normal", "inner": {"type": "direct"}}
        seen = mitsuba.render(tracer.scene, integrator=mitsuba.load_dict(aovs), spp=16, seed=9)
        seen = np.array(seen)
        self.features = {
            "albedo." + c: seen[..., -6 + i] for i, c in enumerate("RGB")
        } | {"normal." + c: seen[..., -3 + i] for i, c in enumerate("XYZ")}

    def render(self, samples, seed, out):
        passes, image = max(1, round(samples / self.tracer.samples)), 0.0
        for number in range(passes):
            image = image + self.tracer.render_pass((seed << 14) + number)[..., :3] / passes
        channels = {c: image[..., i] for i, c in enumerate("RGB")} | self.features
        channels = {name: np.ascontiguousarray(own, dtype=np.float32) for name, own in channels.items()}
        with tempfile.TemporaryDirectory() as folder:
            noisy = pathlib.Path(folder) / "noisy.exr"
            with OpenEXR.File({"type": OpenEXR.scanlineimage}, channels) as file:
                file.write(str(noisy))
            subprocess.run([self.options.bdpm, "denoise", str(noisy), "--output", str(out)], check=True, capture_output=True)
        return interiors.read_luminance(out)


def render_bdpm(options, path, size, seconds, seed, out):
    command = [options.bdpm, "render", str(path), "--output", str(out), "--time", f"{seconds}s", "--denoise"]
    command += ["--threads", str(options.threads), "--seed", str(seed), "--resolution", "{}x{}".format(*size)]
    run = subprocess.run(command + ["--json", "--quiet"], capture_output=True, text=True, check=True)
    names = ["denoised." + c for c in "RGB"]
    with OpenEXR.File(str(out), separate_channels=True) as file:
        channels = file.channels()
        names = names if names[0] in channels else "RGB"
        image = np.stack([channels[name].pixels for name in names], axis=-1)
    return interiors.luminance(image), json.loads(run.stdout)


def own_parts(options, path, size):
    """Images of bdpm by path tracing, for its own reference."""
    parts = []
    for number in range(OWN_PARTS):
        file = path.with_suffix(f".own-reference-{size[0]}-{number}.exr")
        if not file.exists():
            command = [options.bdpm, "render", str(path), "--output", str(file), "--strategy", "path", "--no-denoise"]
            command += ["--time", f"{options.reference}s", "--threads", str(options.threads), "--seed", str(500 + number)]
            subprocess.run(command + ["--resolution", "{}x{}".format(*size), "--quiet"], check=True)
        parts.append(interiors.read_luminance(file))
    return parts


def squares(image, width, height):
    """The image averaged over squares of pixels, so that it has this width."""
    side = image.shape[1] // width
    return image[: height * side, : width * side].reshape(height, side, width, side).mean(axis=(1, 3))


def products(image, parts):
    """For each pixel the mean of (image - part)(image - other part) over all pairs of different parts."""
    differences = image - np.array(parts)
    count = len(parts)
    return (differences.sum(axis=0) ** 2 - (differences**2).sum(axis=0)) / (count * (count - 1))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bdpm", default="target/release/bdpm")
    parser.add_argument("--times", default="5,20,60")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--width", type=int, default=REFERENCE_WIDTH)
    parser.add_argument("--reference", type=float, default=60.0, help="seconds of each part of the reference of bdpm")
    parser.add_argument("--keep", type=pathlib.Path, help="folder for the images")
    parser.add_argument("scenes", nargs="+", type=pathlib.Path)
    options = parser.parse_args()
    print("| scene | pixels | seconds | Mitsuba | bdpm | its report | bdpm over Mitsuba | scenes | chosen |\n|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or pathlib.Path(temporary)
        for path in options.scenes:
            tracer = interiors.PathTracer(path, options.width, options.threads)
            parts = np.load(path.with_suffix(f".reference-{REFERENCE_WIDTH}.npz"))["parts"]
            own = own_parts(options, path, (REFERENCE_WIDTH, parts.shape[1]))
            denoised = Denoised(options, tracer)
            for seconds in map(float, options.times.split(",")):
                images, results = [], []
                for run in range(options.runs):
                    name = f"{path.parent.name}-{options.width}-{seconds:g}-{run}"
                    theirs = denoised.render(tracer.per_second * seconds, 300 + run, folder / f"{name}-mitsuba.exr")
                    ours, result = render_bdpm(options, path, tracer.size, seconds, 1 + run, folder / f"{name}.exr")
                    images.append([squares(image, REFERENCE_WIDTH, parts.shape[1]) for image in (theirs, ours)])
                    results.append(result)
                clean = np.mean(images, axis=(0, 1))
                weights = 1.0 / (clean**2 + 0.01 * clean.mean() ** 2)
                root = lambda squares: max(0.0, float((squares * weights).mean())) ** 0.5
                theirs, ours = (np.mean([root(products(pair[i], (parts, own)[i])) for pair in images]) for i in (0, 1))
                halves = [parts[i::2].mean(axis=0) for i in (0, 1)]
                scenes = root((halves[0] - own[0]) * (halves[1] - own[1]))
                stated = [(result.get("denoised") or {}).get("total_error") for result in results]
                stated = np.mean(stated) if None not in stated else float("nan")
                chosen = ", ".join(sorted({result["settings"]["strategy"] for result in results}))
                pixels = "{}x{}".format(*tracer.size)
                cells = f"{theirs:.3f} | {ours:.3f} | {stated:.3f} | {ours / theirs:.2f} | {scenes:.3f} | `{chosen}`"
                print(f"| {path.parent.name} | {pixels} | {seconds:g} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
