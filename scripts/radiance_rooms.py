#!/usr/bin/env python3
"""Illuminance grids in five rooms, by `bdpm measure` and by `rtrace -I` of Radiance.

Each room is written twice, as a scene file and as a Radiance scene, from the same list of polygons. All reflectances are
gray and diffuse. The result is 0 if both agree in every room.

    python3 -m venv VENV && VENV/bin/pip install pyradiance==1.3.1 numpy
    VENV/bin/python scripts/radiance_rooms.py                # all rooms
    VENV/bin/python scripts/radiance_rooms.py office window  # some of them

The program is target/release/bdpm, or the one that the environment variable BDPM names.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyradiance

FOLDER = Path(pyradiance.__file__).parent
ROOT = Path(__file__).resolve().parent.parent
BDPM = os.environ.get("BDPM", ROOT / "target/release/bdpm")
# Lumens per watt of light of luminance 1, as docs/reference/scene-format.md defines it.
EFFICACY = 683.0
# Settings of rtrace: its defaults with one bounce, and "accurate" and "very accurate" of the usual tables of its
# documentation (rpict.options). The last has no irradiance cache, so that only its noise is left.
SETTINGS = {
    "defaults, -ab 1": ["-ab", "1"],
    "accurate": "-ab 2 -aa .15 -ar 128 -ad 512 -as 256 -dt .05 -dc .5 -ds .15".split(),
    "very accurate": "-ab 5 -aa .08 -ar 512 -ad 2048 -as 512 -dt 0 -dc 1 -ds .02 -lw 1e-4".split(),
}
REFERENCE = "-ab 10 -aa 0 -ad 1500 -as 0 -dt 0 -dc 1 -ds .01 -dj .7 -lw 1e-5".split()


def quad(material, corner, u, v):
    """A parallelogram whose front sees the side of the cross product."""
    corner, u, v = (np.array(vector, float) for vector in (corner, u, v))
    return material, [corner, corner + u, corner + u + v, corner + v]


def shell(size, floor="floor", ceiling="ceiling", wall="wall", window=None):
    """The inside of a box. `window` is (y0, y1, z0, z1) of an opening in the wall at x = 0."""
    x, y, z = size
    quads = [
        quad(floor, (0, 0, 0), (x, 0, 0), (0, y, 0)),
        quad(ceiling, (0, 0, z), (0, y, 0), (x, 0, 0)),
        quad(wall, (0, 0, 0), (0, 0, z), (x, 0, 0)),
        quad(wall, (0, y, 0), (x, 0, 0), (0, 0, z)),
        quad(wall, (x, 0, 0), (0, 0, z), (0, y, 0)),
    ]
    if window is None:
        return quads + [quad(wall, (0, 0, 0), (0, y, 0), (0, 0, z))]
    y0, y1, z0, z1 = window
    pieces = [(0, y, 0, z0), (0, y, z1, z), (0, y0, z0, z1), (y1, y, z0, z1)]
    return quads + [
        quad(wall, (0, a, c), (0, b - a, 0), (0, 0, d - c)) for a, b, c, d in pieces if b > a and d > c
    ]


def box(material, low, high):
    """The outside of a box."""
    (x, y, z), (dx, dy, dz) = low, np.subtract(high, low)
    return [
        quad(material, (x, y, z + dz), (dx, 0, 0), (0, dy, 0)),
        quad(material, (x, y, z), (0, dy, 0), (dx, 0, 0)),
        quad(material, (x, y, z), (dx, 0, 0), (0, 0, dz)),
        quad(material, (x, y + dy, z), (0, 0, dz), (dx, 0, 0)),
        quad(material, (x, y, z), (0, 0, dz), (0, dy, 0)),
        quad(material, (x + dx, y, z), (0, dy, 0), (0, 0, dz)),
    ]


def panel(x, y, z, side=0.6, up=False):
    """A square lamp around a point that shines down, or up."""
    half = side / 2
    edges = ((side, 0, 0), (0, side, 0)) if up else ((0, side, 0), (side, 0, 0))
    return quad("lamp", (x - half, y - half, z), *edges)


def rooms():
    """Name, polygons, reflectances, radiance of the lamps, radiance of the sky, and size of each room."""
    usual = {"floor": 0.2, "ceiling": 0.8, "wall": 0.5, "box": 0.4}
    desks = box("box", (1, 1, 0.6), (2.6, 1.8, 0.64)) + box("box", (4, 1, 0.6), (5.6, 1.8, 0.64))
    yield (
        "office", shell((7, 4, 3)) + desks + [panel(x, 2, 2.999) for x in (1.2, 3.5, 5.8)],
        usual, 4.66, 0, (7, 4, 3),
    )
    yield (
        "uplights", shell((6, 4, 3)) + [panel(x, 2, 2.2, up=True) for x in (1.5, 4.5)],
        usual, 12, 0, (6, 4, 3),
    )
    yield (
        "corridor", shell((20, 2, 2.6)) + [panel(x, 1, 2.599, 0.3) for x in (3, 10, 17)],
        {**usual, "wall": 0.7}, 10, 0, (20, 2, 2.6),
    )
    yield (
        "window", shell((6, 4, 3), window=(1, 3, 1, 2.4)) + desks[:6],
        usual, 0, 2, (6, 4, 3),
    )
    screen = box("box", (2.9, 0, 0), (3.1, 3, 2.2))
    yield (
        "dark room with a screen", shell((6, 4, 3)) + screen + [panel(1, 2, 2.999)],
        {"floor": 0.1, "ceiling": 0.3, "wall": 0.2, "box": 0.2}, 10, 0, (6, 4, 3),
    )


def meters(size):
    """Centers of a grid of 6 by 4 cells, 0.8 m above the floor."""
    x, y, _ = size
    return [((i + 0.5) * x / 6, (j + 0.5) * y / 4, 0.8) for j in range(4) for i in range(6)]


def write_scene(folder, polygons, reflectances, lamp, sky, size):
    """Writes scene.toml and room.obj."""
    lines, faces, current = [], [], None
    for material, corners in polygons:
        first = len(lines) + 1
        lines += ["v " + " ".join(f"{c:.9g}" for c in corner) for corner in corners]
        if material != current:
            faces.append(f"g {material}\nusemtl {material}")
            current = material
        faces.append("f " + " ".join(str(first + k) for k in range(4)))
    (folder / "room.obj").write_text("\n".join(lines + faces) + "\n")
    x, y, _ = size
    text = "[camera]\nposition = [0.1, 0.1, 1]\ntarget = [1, 1, 1]\nup = [0, 0, 1]\nfov_x_deg = 60\n"
    text += "[[mesh]]\nfile = \"room.obj\"\n"
    used = {material for material, _ in polygons}
    for name, albedo in reflectances.items():
        if name in used:
            text += f"[materials.{name}]\nalbedo = {albedo}\n"
    if "lamp" in used:
        text += f"[materials.lamp]\nalbedo = 0\nemission = {lamp}\n"
    if sky:
        text += f"[environment]\nradiance = {sky}\n"
    text += (
        f"[[meter]]\nname = \"plane\"\ncorner = [0, 0, 0.8]\nedges = [[{x}, 0, 0], [0, {y}, 0]]\n"
        "normal = [0, 0, 1]\ncolumns = 6\nrows = 4\n"
    )
    (folder / "scene.toml").write_text(text)


def write_radiance(folder, polygons, reflectances, lamp, sky):
    """Writes room.oct."""
    text = ""
    for name, albedo in reflectances.items():
        text += f"void plastic {name}\n0\n0\n5 {albedo} {albedo} {albedo} 0 0\n"
    text += f"void light lamp\n0\n0\n3 {lamp} {lamp} {lamp}\n"
    if sky:
        text += f"void glow sky\n0\n0\n4 {sky} {sky} {sky} 0\nsky source dome\n0\n0\n4 0 0 1 360\n"
    for number, (material, corners) in enumerate(polygons):
        numbers = " ".join(f"{c:.9g}" for corner in corners for c in corner)
        text += f"{material} polygon p{number}\n0\n0\n12 {numbers}\n"
    (folder / "room.rad").write_text(text)
    octree = subprocess.run(
        [FOLDER / "bin/oconv", "room.rad"], cwd=folder, capture_output=True, check=True,
        env=dict(os.environ, RAYPATH=f".:{FOLDER / 'lib'}"),
    )
    (folder / "room.oct").write_bytes(octree.stdout)


def by_radiance(folder, size, settings):
    """Illuminances by rtrace, lx, and its seconds."""
    rays = "\n".join(" ".join(f"{c:.9g}" for c in point) + " 0 0 1" for point in meters(size))
    start = time.perf_counter()
    done = subprocess.run(
        [FOLDER / "bin/rtrace", "-I", "-h", "-n", "2", *settings, "room.oct"],
        input=rays + "\n", cwd=folder, capture_output=True, text=True, check=True,
        env=dict(os.environ, RAYPATH=f".:{FOLDER / 'lib'}"),
    )
    seconds = time.perf_counter() - start
    values = [float(line.split()[1]) for line in done.stdout.splitlines() if line.strip()]
    return EFFICACY * np.array(values), seconds


def by_bdpm(program, folder, options):
    """Illuminances by bdpm, lx, their expanded uncertainties, and its seconds."""
    done = subprocess.run(
        [program, "measure", folder / "scene.toml", "--json", "--quiet", *options],
        capture_output=True, text=True, check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(done.stderr.strip())
    report = json.loads(done.stdout)
    readings = report["meters"][0]["readings"]
    value, expanded = ([reading[key] for reading in readings] for key in ("value", "expanded"))
    return np.array(value), np.array(expanded), report["seconds"], report["techniques"][0]


def compare(program, only=None):
    """Prints a table for each room; returns the number of rooms in which both disagree."""
    failures = 0
    print("| room | by | seconds | mean, lx | RMS error | largest error |")
    print("|---|---|---|---|---|---|")
    for name, polygons, reflectances, lamp, sky, size in rooms():
        if only and name not in only:
            continue
        with tempfile.TemporaryDirectory() as path:
            folder = Path(path)
            write_scene(folder, polygons, reflectances, lamp, sky, size)
            write_radiance(folder, polygons, reflectances, lamp, sky)
            truth, expanded, seconds, technique = by_bdpm(program, folder, ["--target-error", "0.5%"])
            print(
                f"| {name} | bdpm, reference by {technique} | {seconds:.1f} | {truth.mean():.2f} "
                f"| +- {100 * np.max(expanded / truth):.2f} % | |", flush=True,
            )

            def row(by, seconds, values):
                off = values / truth - 1
                print(
                    f"| {name} | {by} | {seconds:.1f} | {values.mean():.2f} "
                    f"| {100 * np.sqrt(np.mean(off**2)):.2f} % | {100 * np.abs(off).max():.2f} % |",
                    flush=True,
                )

            # Runs with other random numbers give the uncertainty of Radiance.
            runs = [by_radiance(folder, size, [*REFERENCE, "-u+"]) for _ in range(3)]
            values = np.array([own for own, _ in runs])
            spread = values.std(axis=0, ddof=1) / np.sqrt(len(runs))
            judge = values.mean(axis=0)
            row("rtrace without a cache, 3 runs", sum(seconds for _, seconds in runs), judge)
            # The sums of both are compared, with the noise of all meters of Radiance.
            off = judge.sum() - truth.sum()
            allowed = 4.3 * np.sqrt((spread**2).sum()) + expanded.mean() * len(truth)
            failures += abs(off) > allowed
            verdict = "agree" if abs(off) <= allowed else "DISAGREE"
            print(f"| {name} | both {verdict} | | {100 * off / truth.sum():+.2f} % +- {100 * allowed / truth.sum():.2f} % | | |")
            for setting, options in SETTINGS.items():
                values, seconds = by_radiance(folder, size, options)
                row(f"rtrace, {setting}", seconds, values)
                seconds = max(seconds, 1.0)
                values, _, taken, technique = by_bdpm(program, folder, ["--time", f"{seconds:.2f}s"])
                row(f"bdpm by {technique.split(',')[0]}", taken, values)
    return failures


if __name__ == "__main__":
    sys.exit(min(compare(BDPM, only=sys.argv[1:]), 1))
