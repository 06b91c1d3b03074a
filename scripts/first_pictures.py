#!/usr/bin/env python3
"""Errors of first pictures at 1920x1080, after averaging over 8x8 pixels, as rows of a table.

usage: first_pictures.py [--keep FOLDER] [--scenes NAME=SECONDS,...] PROGRAM...

Each program renders each scene without options but size and time. What counts is the picture: the denoised one where
there is one. The reference has 240x135 pixels and a minute, by the last program. Errors are roots of means of
(L - R)^2/(R^2 + 0.01 mean(R)^2) of the luminance, and contain that of the reference, which is stated. Run it on a
machine that does nothing else. 5 minutes for two programs. Wants OpenEXR and numpy; `ratchet.py` makes an environment
that has both.
"""

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path

import ratchet

DEFAULT = "hall=30,materials=20,caustic-sphere=20,point-caustic=30,daylight=20,smoke=20"
SIDE = 8


def luminances(path):
    """Luminance of the picture that a file has."""
    import numpy
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        prefix = "denoised." if "denoised.R" in channels else ""
        pixels = numpy.stack([numpy.asarray(channels[prefix + name].pixels, float) for name in "RGB"], -1)
    return pixels @ numpy.array(ratchet.LUMINANCE)


def render(program, scene, size, seconds, image, *options):
    begun = time.monotonic()
    command = [program, "render", ratchet.ROOT / "scenes" / scene, "--resolution", size, "--time", f"{seconds:g}s"]
    command += ["--output", image, *options, "--json", "--quiet"]
    run = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=True)
    return json.loads(run.stdout), time.monotonic() - begun


def error(image, reference):
    import numpy

    weights = 1 / (reference**2 + 0.01 * reference.mean() ** 2)
    return float(numpy.mean((image - reference) ** 2 * weights)) ** 0.5, float(image.mean() / reference.mean())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", nargs="+", type=Path)
    parser.add_argument("--scenes", default=DEFAULT)
    parser.add_argument("--keep", type=Path, help="keep images and previews here")
    own = parser.parse_args()
    folder = own.keep or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    print("| scene | time | program | strategy | iterations | took | error | mean | of the reference |\n" + "|---" * 9 + "|")
    for name, seconds in (item.split("=") for item in own.scenes.split(",")):
        exact = folder / f"{name}-reference.exr"
        report, _ = render(own.programs[-1], name, "240x135", 60, exact, "--no-denoise")
        reference, stated = luminances(exact), report["error"]["total"]
        for number, program in enumerate(own.programs):
            image = folder / f"{name}-{number}.exr"
            report, took = render(program, name, "1920x1080", float(seconds), image)
            pixels = luminances(image)
            height, width = (side // SIDE for side in pixels.shape)
            averages = pixels.reshape(height, SIDE, width, SIDE).mean((1, 3))
            off, mean = error(averages, reference)
            strategy, iterations = report["settings"]["strategy"], report["iterations"]
            numbers = f"{took:.1f} s | {100 * off:.1f} % | {mean:.3f} | {100 * stated:.1f} %"
            print(f"| {name} | {seconds} s | {number} | {strategy} | {iterations} | {numbers} |", flush=True)


if __name__ == "__main__":
    ratchet.in_environment()
    main()
