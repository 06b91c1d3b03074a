#!/usr/bin/env python3
"""Compares bdpm with Radiance, whose programs the wheel `pyradiance` ships.

Section `luminaires`: intensities of IES files. `ies2rad` converts each file, `rtrace` evaluates its light source from
10,000 directions, and the example `luminaire_intensity` of this project evaluates the file itself. Radiance
interpolates bilinearly in the same angles, so that both agree to the rounding of its text files. Files of the types A
and B are left out, and directions outside of the angles of a file, where Radiance extrapolates: ies2rad does not read type A, and `source.cal` has other angles for type B.

Section `glare`: DGP, UGR and vertical illuminance of synthetic fisheye images by `bdpm glare` and by `evalglare`. The
program is target/debug/bdpm, or the one that the environment variable BDPM names.

    python3 -m venv VENV && VENV/bin/pip install pyradiance==1.3.1 numpy
    cargo build --example luminaire_intensity
    VENV/bin/python scripts/radiance_check.py luminaires FILE.ies ...
    VENV/bin/python scripts/radiance_check.py glare
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pyradiance

DIRECTIONS = 10_000
# W/(sr m^2) of Radiance stand for lumens by this factor.
RADIANCE_EFFICACY = 179.0
# Largest difference that counts as equal, relative to the peak: single precision and six digits in text files.
TOLERANCE = 2e-4

FOLDER = Path(pyradiance.__file__).parent
ROOT = Path(__file__).resolve().parent.parent
BDPM = os.environ.get("BDPM", ROOT / "target/debug/bdpm")
INTENSITY = ROOT / "target/debug/examples/luminaire_intensity"


def run(command, text=None, **options):
    """Runs a program and returns its output."""
    environment = dict(os.environ, RAYPATH=f".:{FOLDER / 'lib'}")
    done = subprocess.run(
        command, input=text, capture_output=True, text=True, env=environment, check=False, **options
    )
    if done.returncode != 0:
        raise RuntimeError(f"{command[0]}: {done.stderr.strip()}")
    return done.stdout


def directions():
    """Unit vectors all around, from a seeded generator."""
    rng = np.random.default_rng(1)
    vectors = rng.normal(size=(DIRECTIONS, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def by_radiance(path, folder, vectors):
    """Intensities that ies2rad's distribution has, cd."""
    if photometric_type(path) != 1:
        raise RuntimeError("its photometric type is not C")
    program = FOLDER / "bin"
    run([program / "ies2rad", "-t", "default", "-o", "lamp", path], cwd=folder)
    # The distribution alone, on a sphere of the radius 1: its radiance there is that of `corr`.
    text = (folder / "lamp.rad").read_text(encoding="latin-1")
    text = "\n".join(line for line in text.splitlines() if not line.startswith("#"))
    modifier = next(line for line in text.splitlines() if " brightdata 'lamp_dist'" in line)
    words = text[text.index(modifier) :].split()
    # modifier, "brightdata", name, count, function, data file, source.cal, coordinates..., 0, count, arguments
    count = int(words[3])
    function, data, library, *coordinates = words[4 : 4 + count]
    arguments = words[4 + count + 2 :]
    scale = float(words[4 + count + 2])
    if function == "flatcorr" or function == "corr":
        # The first argument is the multiplier over the area. The header states the area of the shape.
        area = shape_area(text)
        multiplier = scale * area
    else:
        multiplier = float(arguments[0])
    scene = (
        f"void brightdata d\n{count} corr {data} {library} {' '.join(coordinates)}\n0\n1 {multiplier}\n"
        "d glow g\n0\n0\n4 1 1 1 0\n"
        "g sphere s\n0\n0\n4 0 0 0 1\n"
    )
    (folder / "judge.rad").write_text(scene)
    octree = subprocess.run(
        [program / "oconv", "judge.rad"], cwd=folder, capture_output=True, check=True,
        env=dict(os.environ, RAYPATH=f".:{FOLDER / 'lib'}"),
    ).stdout
    (folder / "judge.oct").write_bytes(octree)
    rays = "\n".join(" ".join(f"{x:.9g}" for x in (*(3 * v), *(-v))) for v in vectors)
    out = run([program / "rtrace", "-h", "-ab", "0", "-ov", "judge.oct"], text=rays + "\n", cwd=folder)
    values = np.array([float(line.split()[1]) for line in out.splitlines() if line.strip()])
    # Outside of the angles of the file, Radiance extrapolates, also to negative values.
    first, last = vertical_range(folder / "lamp.dat")
    gamma = np.degrees(np.arccos(np.clip(-vectors[:, 2], -1, 1)))
    inside = (gamma >= first) & (gamma <= last)
    return np.where(inside, RADIANCE_EFFICACY * values, np.nan)


def photometric_type(path):
    """The photometric type of an IES file: 1 (C), 2 (B) or 3 (A)."""
    text = path.read_text(encoding="latin-1")
    at = re.search(r"^\s*TILT\s*=", text, re.MULTILINE | re.IGNORECASE).end() - 5
    words = text[at:].split("\n", 1)[1].replace(",", " ").split()
    if "INCLUDE" in text[at:].split("\n", 1)[0].upper():
        words = words[2 + 2 * int(words[1]) :]
    return int(float(words[5]))


def vertical_range(path):
    """Smallest and largest vertical angle of the data file of ies2rad, degrees."""
    words = iter(path.read_text().split())
    for _ in range(int(next(words))):
        first, last, count = float(next(words)), float(next(words)), int(next(words))
        if first == last:
            angles = [float(next(words)) for _ in range(count)]
            first, last = angles[0], angles[-1]
    return first, last


def shape_area(text):
    """The area by which ies2rad divides: of the lower or upper rectangle, disk or sphere."""
    words = text.split()
    for kind in ("polygon", "ring", "sphere"):
        if kind not in words:
            continue
        at = words.index(kind) + 2
        count = int(words[at + 2])
        numbers = [float(word) for word in words[at + 3 : at + 3 + count]]
        if kind == "polygon":
            points = np.array(numbers).reshape(-1, 3)
            return np.linalg.norm(np.cross(points[1] - points[0], points[3] - points[0]))
        radius = numbers[7] if kind == "ring" else numbers[3]
        return np.pi * radius**2
    raise RuntimeError("there is no surface")


def by_bdpm(path, vectors):
    """Intensities by bdpm, cd."""
    rows = "\n".join(" ".join(f"{x:.17g}" for x in v) for v in vectors)
    return np.array([float(line) for line in run([INTENSITY, path], text=rows + "\n").split()])


def luminaires(files):
    """Compares each file; returns the number of those that differ."""
    vectors = directions()
    failures = 0
    for path in map(Path, files):
        with tempfile.TemporaryDirectory() as folder:
            try:
                theirs = by_radiance(path.resolve(), Path(folder), vectors)
            except (RuntimeError, StopIteration) as problem:
                print(f"{path.name}: left out, {problem}")
                continue
            ours = by_bdpm(path.resolve(), vectors)
        inside = ~np.isnan(theirs)
        peak = max(theirs[inside].max(), ours.max())
        off = np.abs(theirs - ours)[inside].max() / peak if peak > 0 else 0.0
        # Outside of its angles the luminaire is dark.
        off = max(off, ours[~inside].max(initial=0) / peak)
        verdict = "equal" if off < TOLERANCE else "DIFFERENT"
        failures += off >= TOLERANCE
        print(f"{path.name}: {verdict}, largest difference {off:.2e} of the peak {peak:.1f} cd")
    return failures


# Background luminance, cd/m^2, and sources: degrees to the right and up, radius in degrees, luminance in cd/m^2.
SCENES = {
    "window": (300, [(25, 10, 12, 6000)]),
    "bright": (1500, [(-10, 15, 10, 15000), (30, 5, 4, 40000)]),
    "dim": (30, [(15, 20, 3, 8000)]),
    "below": (200, [(5, -20, 5, 10000), (-40, 30, 6, 5000)]),
    "office": (80, [(0, 35, 4, 5000), (-25, 40, 4, 5000), (25, 40, 4, 5000)]),
    "sun": (800, [(20, 25, 8, 8000), (20, 25, 1.5, 5e5)]),
    "dark sun": (200, [(20, 25, 8, 8000), (20, 25, 1.5, 5e5)]),
    "window and sun": (1000, [(-15, 30, 20, 6000), (-15, 30, 1, 2e6)]),
    "two peaks": (500, [(10, 20, 5, 2e4), (10, 20, 1, 8e4), (10, 26, 1, 9e4)]),
    "peak alone": (500, [(-30, 20, 3, 6e4), (30, 20, 3, 3e4)]),
}
SIDE = 800


def write_fisheye(path, background, sources):
    """Writes an equidistant fisheye image of a half-space as an uncompressed Radiance picture."""
    at = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    x, y = np.meshgrid(at, -at)
    share = np.hypot(x, y)
    theta = share * np.pi / 2
    across = np.divide(np.sin(theta), share, out=np.ones_like(share), where=share > 0)
    direction = np.stack([x * across, y * across, np.cos(theta)], axis=-1)
    value = np.full((SIDE, SIDE), float(background))
    for right, up, radius, luminance in sources:
        right, up = np.radians([right, up])
        center = np.array([np.sin(right) * np.cos(up), np.sin(up), np.cos(right) * np.cos(up)])
        value[direction @ center > np.cos(np.radians(radius))] = luminance
    value[share > 1] = 0
    radiance = value / RADIANCE_EFFICACY
    mantissa, exponent = np.frexp(radiance)
    pixel = np.where(radiance > 1e-32, mantissa * 256, 0).astype(np.uint8)
    rgbe = np.stack([pixel, pixel, pixel, np.where(pixel > 0, exponent + 128, 0).astype(np.uint8)], axis=-1)
    view = "VIEW= -vta -vp 0 0 0 -vd 0 0 1 -vu 0 1 0 -vh 180 -vv 180"
    head = f"#?RADIANCE\n{view}\nFORMAT=32-bit_rle_rgbe\n\n-Y {SIDE} +X {SIDE}\n"
    path.write_bytes(head.encode() + rgbe.tobytes())


def glare():
    """Compares both programs; returns the number of images in which they differ."""
    failures = 0
    for name, (background, sources) in SCENES.items():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "view.hdr"
            write_fisheye(path, background, sources)
            out = run([FOLDER / "bin" / "evalglare", "-d", path])
            last = [line for line in out.splitlines() if line.startswith("dgp,")][-1]
            names, numbers = last.split(":")
            theirs = dict(zip(names.split(","), map(float, numbers.split())))
            ours = json.loads(run([BDPM, "glare", path, "--efficacy", "179", "--json"]))
        pairs = {
            "DGP": (ours["dgp"], theirs["dgp"], 0.005),
            "UGR": (ours["ugr"], theirs["ugr"], 0.2),
            "E_v": (ours["vertical_illuminance"], theirs["E_v"], 0.01 * theirs["E_v"]),
            "L_b": (ours["background_luminance"], theirs["lum_backg"], 0.01 * theirs["lum_backg"]),
        }
        equal = all(abs(own - other) <= tolerance for own, other, tolerance in pairs.values())
        failures += not equal
        shown = ", ".join(f"{key} {own:.4f} {other:.4f}" for key, (own, other, _) in pairs.items())
        print(f"{name}: {'equal' if equal else 'DIFFERENT'}; bdpm and evalglare: {shown}")
    return failures


def main():
    """Runs the sections that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    sections = parser.add_subparsers(dest="section", required=True)
    section = sections.add_parser("luminaires", help="intensities of IES files against ies2rad")
    section.add_argument("files", nargs="+", metavar="FILE.ies")
    sections.add_parser("glare", help="glare of synthetic images against evalglare")
    arguments = parser.parse_args()
    failures = glare() if arguments.section == "glare" else luminaires(arguments.files)
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
