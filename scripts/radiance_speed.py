#!/usr/bin/env python3
"""Seconds to equal errors beside Radiance: illuminance of grids of 400 points, and a year of daylight at 16 points.

    python3 -m venv VENV && VENV/bin/pip install pyradiance==1.3.1 numpy
    VENV/bin/python scripts/radiance_speed.py WEATHER.epw

Grids: the rooms "office" and "window" of radiance_rooms.py, with `rtrace -n 2` without a cache (-ab 10 -aa 0) at growing
-ad, and `bdpm measure` at growing times. Year: the southern room of daylight_check.py, `rfluxmtx -n 2` at growing -ad, and
`bdpm daylight`. The error is the root mean square over the points, relative: of grids beside 90 s of `bdpm`, with which
`rtrace` agrees within .4 % (radiance_rooms.py), of the year beside a long run of the same program, since both have other
suns. The last column is the time at which the error would be 1 %, by the
square root of the time. The program is target/release/bdpm, or the one that the environment variable BDPM names.
"""

import sys
import tempfile
from pathlib import Path

import daylight_check
import numpy as np
import radiance_rooms as rooms

SIDE = 20
DIVISIONS = {"office": (16, 64), "window": (64, 256, 1024)}


def points(size):
    x, y, _ = size
    return [((i + 0.5) * x / SIDE, (j + 0.5) * y / SIDE, 0.8) for j in range(SIDE) for i in range(SIDE)]


def row(what, by, seconds, values, truth):
    error = np.sqrt(np.mean((values / truth - 1) ** 2))
    print(f"| {what} | {by} | {seconds:.1f} | {100 * error:.2f} % | {seconds * (error / 0.01) ** 2:.1f} |", flush=True)


def grids(name, polygons, reflectances, lamp, sky, size):
    rooms.meters = points
    with tempfile.TemporaryDirectory() as path:
        folder = Path(path)
        rooms.write_scene(folder, polygons, reflectances, lamp, sky, size)
        scene = folder / "scene.toml"
        scene.write_text(scene.read_text().replace("columns = 6\nrows = 4", f"columns = {SIDE}\nrows = {SIDE}"))
        rooms.write_radiance(folder, polygons, reflectances, lamp, sky)
        truth = rooms.by_bdpm(rooms.BDPM, folder, ["--time", "90s"])[0]
        for ad in DIVISIONS[name]:
            values, seconds = rooms.by_radiance(folder, size, [*rooms.REFERENCE, "-ad", str(ad), "-u+"])
            row(name, f"rtrace -ad {ad}", seconds, values, truth)
        for seconds in (2, 6, 20):
            values, _, taken, _ = rooms.by_bdpm(rooms.BDPM, folder, ["--time", f"{seconds}s", "--seed", "7"])
            row(name, f"bdpm --time {seconds}s", taken, values, truth)


def year(weather):
    quads, _, size = daylight_check.room("south")
    with tempfile.TemporaryDirectory() as path:
        folder = Path(path)

        def rfluxmtx(ad):
            daylight_check.MATRIX = f"-ab 7 -ad {ad} -lw {0.03 / ad:g} -n 2 -u+".split()
            mean, _, seconds = daylight_check.by_radiance(folder, quads, size, weather)
            return mean, seconds

        truth = rfluxmtx(400000)[0]
        for ad in (1000, 10000, 60000):
            values, seconds = rfluxmtx(ad)
            row("year", f"rfluxmtx -ad {ad}", seconds, values, truth)
        truth = daylight_check.by_bdpm(folder, quads, size, weather, ("--time", "90s", "--seed", "9"))[0]
        for seconds in (3, 6, 20):
            values, *_, taken = daylight_check.by_bdpm(folder, quads, size, weather, ("--time", f"{seconds}s"))
            row("year", f"bdpm --time {seconds}s", taken, values, truth)


def main():
    print("| what | by | seconds | error | seconds to 1 % |\n|---|---|---|---|---|")
    for name, *own in rooms.rooms():
        if name in DIVISIONS:
            grids(name, *own)
    year(Path(sys.argv[1]).resolve())


if __name__ == "__main__":
    main()
