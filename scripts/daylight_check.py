#!/usr/bin/env python3
"""The daylight of a year by `bdpm daylight` beside the matrices of Radiance, as a Markdown table.

    python3 -m venv VENV && VENV/bin/pip install pyradiance==1.3.1 numpy
    VENV/bin/python scripts/daylight_check.py WEATHER.epw [WEATHER.epw ...]
    VENV/bin/python scripts/daylight_check.py --coverage WEATHER.epw    # 40 seeds beside a long run

Five rooms with windows to the south, the east, through a pane of glass, below an overhang, and behind a venetian blind as
a BSDF of Klems patches. Radiance: `rfluxmtx` with the sky of MF:2,
ground included, and `gendaymtx -m 2 -O0`; both programs make lux of irradiances by the efficacies of Perez. The matrices
smear the sun over the nearest patches, so that single hours differ. Columns: mean illuminance of the occupied hours by
both, bdpm over Radiance, the half-width of bdpm's interval; autonomy at 300 lx, mean over the points by both, its
half-width; seconds. With --coverage: how many of the intervals of 640 means, and of as many shares of hours, hold the
values of a run of 400,000 paths. The program is target/release/bdpm, or the one that the environment variable BDPM names.
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
from radiance_scenes import blind

FOLDER = Path(pyradiance.__file__).parent
ROOT = Path(__file__).resolve().parent.parent
BDPM = os.environ.get("BDPM", ROOT / "target/release/bdpm")
MATRIX = "-ab 7 -ad 30000 -lw 1e-6 -n 2".split()
SECONDS = 20
REFLECTANCES = {"floor": 0.2, "ceiling": 0.8, "wall": 0.5}
RECEIVERS = """#@rfluxmtx h=u u=Y
void glow ground_glow
0
0
4 1 1 1 0
ground_glow source ground
0
0
4 0 0 -1 180
#@rfluxmtx h=r2 u=Y
void glow sky_glow
0
0
4 1 1 1 0
sky_glow source sky
0
0
4 0 0 1 180
"""


def quad(material, corner, u, v):
    """A parallelogram whose front sees the side of the cross product; x is east, y north, z up."""
    corner, u, v = (np.array(vector, float) for vector in (corner, u, v))
    return material, [corner, corner + u, corner + u + v, corner + v]


def room(side):
    """A room of 4 m by 6 m and 3 m high, whose window of 3 m by 1.5 m is in the south or the east."""
    x, y, z = (4.0, 6.0, 3.0) if side == "south" else (6.0, 4.0, 3.0)
    quads = [
        quad("floor", (0, 0, 0), (x, 0, 0), (0, y, 0)),
        quad("ceiling", (0, 0, z), (0, y, 0), (x, 0, 0)),
        quad("wall", (0, y, 0), (x, 0, 0), (0, 0, z)),
        quad("wall", (0, 0, 0), (0, y, 0), (0, 0, z)),
    ]
    low, high, sill, lintel = 0.5, 3.5, 0.9, 2.4
    pieces = [(0, 4.0, 0, sill), (0, 4.0, lintel, z), (0, low, sill, lintel), (high, 4.0, sill, lintel)]
    for a, b, c, d in pieces:
        if side == "south":
            quads.append(quad("wall", (a, 0, c), (0, 0, d - c), (b - a, 0, 0)))
        else:
            quads.append(quad("wall", (x, a, c), (0, 0, d - c), (0, b - a, 0)))
    other = ("wall", (x, 0, 0), (0, 0, z), (0, y, 0)) if side == "south" else ("wall", (0, 0, 0), (0, 0, z), (x, 0, 0))
    window = ((low, 0, sill), (0, 0, lintel - sill), (high - low, 0, 0)) if side == "south" else None
    return quads + [quad(*other)], window, (x, y)


def points(size):
    x, y = size
    return [((i + 0.5) * x / 4, (j + 0.5) * y / 4, 0.8) for j in range(4) for i in range(4)]


def ours(vector):
    """A vector of Radiance in the frame of bdpm: y is up, -z north."""
    x, y, z = vector
    return x, z, -y


def by_bdpm(folder, quads, size, weather, options=("--time", f"{SECONDS}s")):
    lines, faces = [], []
    for material, corners in quads:
        lines += ["v {:.9g} {:.9g} {:.9g}".format(*ours(corner)) for corner in corners]
        faces += [f"usemtl {material}", "f " + " ".join(str(len(lines) - 3 + k) for k in range(4))]
    (folder / "room.obj").write_text("\n".join(lines + faces) + "\n")
    text = "[camera]\nposition = [2, 1, -2]\ntarget = [2, 1, -3]\nfov_x_deg = 60\n[environment]\nradiance = 1\n"
    text += '[[mesh]]\nfile = "room.obj"\n'
    for name, albedo in REFLECTANCES.items():
        text += f"[materials.{name}]\nalbedo = {albedo}\n"
    if any(material == "glass" for material, _ in quads):
        text += '[materials.glass]\ntype = "thin-dielectric"\nior = 1.52\n'
    if any(material == "blind" for material, _ in quads):
        text += '[materials.blind]\ntype = "klems"\nfile = "blind.xml"\n'
    (folder / "scene.toml").write_text(text)
    rows = [f"{i},{x},{z},{-y},0,1,0" for i, (x, y, z) in enumerate(points(size))]
    (folder / "meters.csv").write_text("name,x,y,z,nx,ny,nz\n" + "\n".join(rows) + "\n")
    start = time.perf_counter()
    command = [BDPM, "daylight", folder / "scene.toml", "--weather", weather, "--meters", folder / "meters.csv"]
    command += [*options, "--json", "--quiet"]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(done.stderr)
    report = json.loads(done.stdout)
    own = [meter["points"][0] for meter in report["meters"]]
    mean, width, autonomy, share = (
        np.array([point[key][which] for point in own])
        for key, which in [("mean", "value"), ("mean", "expanded"), ("autonomy", "value"), ("autonomy", "expanded")]
    )
    return mean, width, autonomy, share, time.perf_counter() - start


def run(folder, command, stdin=None):
    environment = dict(os.environ, RAYPATH=f".:{FOLDER / 'lib'}", PATH=f"{FOLDER / 'bin'}:{os.environ['PATH']}")
    done = subprocess.run(
        [str(part) for part in command], cwd=folder, input=stdin, capture_output=True, text=True, env=environment
    )
    if done.returncode != 0:
        sys.exit(f"{command}: {done.stderr}")
    return done.stdout


def numbers(text):
    """The numbers after the header of a matrix, which ends with an empty line."""
    return np.array(text.split("\n\n", 1)[1].split(), float)


def by_radiance(folder, quads, size, weather):
    text = ""
    for name, albedo in REFLECTANCES.items():
        text += f"void plastic {name}\n0\n0\n5 {albedo} {albedo} {albedo} 0 0\n"
    # The transmissivity of 6 mm of clear glass without absorption is 1 in the model of Radiance.
    text += "void glass glass\n0\n0\n4 1 1 1 1.52\n"
    if any(material == "blind" for material, _ in quads):
        text += "void BSDF blind\n6 0 blind.xml 0 0 1 .\n0\n0\n"
    for number, (material, corners) in enumerate(quads):
        text += f"{material} polygon p{number}\n0\n0\n12 " + " ".join(f"{c:.9g}" for own in corners for c in own) + "\n"
    (folder / "room.rad").write_text(text)
    (folder / "sky.rad").write_text(RECEIVERS)
    rays = "\n".join(f"{x} {y} {z} 0 0 1" for x, y, z in points(size)) + "\n"
    start = time.perf_counter()
    matrix = run(folder, ["rfluxmtx", "-I+", "-y", 16, *MATRIX, "-", "sky.rad", "room.rad"], rays)
    (folder / "flux.mtx").write_text(matrix)
    run(folder, ["epw2wea", weather, "weather.wea"])
    (folder / "weather.smx").write_text(run(folder, ["gendaymtx", "-m", 2, "-O0", "-g", 0.2, 0.2, 0.2, "weather.wea"]))
    result = run(folder, ["dctimestep", "flux.mtx", "weather.smx"])
    lux = numbers(result).reshape(16, -1, 3) @ np.array([47.4, 119.9, 11.6])
    hours = [float(line.split()[2]) for line in (folder / "weather.wea").read_text().splitlines()[6:] if line.strip()]
    occupied = np.array([8 <= hour < 18 for hour in hours])
    lux = lux[:, occupied]
    return lux.mean(axis=1), 100 * (lux >= 300).mean(axis=1), time.perf_counter() - start


def coverage(weather):
    """Shares of intervals that hold."""
    quads, _, size = room("south")
    with tempfile.TemporaryDirectory() as path:
        folder = Path(path)
        truth = by_bdpm(folder, quads, size, weather, ("--paths", "400000", "--seed", "1000"))
        held = np.zeros(2)
        for seed in range(40):
            own = by_bdpm(folder, quads, size, weather, ("--paths", "4096", "--seed", str(seed)))
            for number, (value, width) in enumerate([(0, 1), (2, 3)]):
                # The long run has intervals, too.
                allowed = np.hypot(own[width], truth[width]) if number == 0 else own[width] + truth[width]
                held[number] += (np.abs(own[value] - truth[value]) <= allowed + 1e-9).sum()
    print(f"means {100 * held[0] / 640:.1f} %, autonomy {100 * held[1] / 640:.1f} % of 640 intervals hold")


def main():
    if sys.argv[1:2] == ["--coverage"]:
        coverage(Path(sys.argv[2]).resolve())
        return
    print("| weather | window | mean, lx | Radiance | ratio | ± | autonomy | Radiance | ± | seconds | Radiance |")
    print("|---|---|---|---|---|---|---|---|---|---|---|", flush=True)
    for weather in sys.argv[1:]:
        weather = Path(weather).resolve()
        for name in ("south", "east", "south, glass", "south, overhang", "south, blind"):
            quads, window, size = room(name.split(",")[0])
            if "glass" in name:
                quads.append(quad("glass", *window))
            if "overhang" in name:
                quads.append(quad("wall", (0, -1.5, 2.5), (0, 1.5, 0), (4, 0, 0)))
            if "blind" in name:
                quads.append(quad("blind", *window))
            with tempfile.TemporaryDirectory() as path:
                folder = Path(path)
                if "blind" in name:
                    blind(folder)
                mean, width, autonomy, share, seconds = by_bdpm(folder, quads, size, weather)
                other, other_autonomy, other_seconds = by_radiance(folder, quads, size, weather)
            ratio, error = mean.sum() / other.sum(), np.sqrt((width**2).sum()) / mean.sum()
            print(
                f"| {weather.stem.split('.')[0]} | {name} | {mean.mean():.0f} | {other.mean():.0f} | {ratio:.3f} | {error:.3f} "
                f"| {autonomy.mean():.1f} % | {other_autonomy.mean():.1f} % | {share.mean():.1f} % "
                f"| {seconds:.0f} | {other_seconds:.0f} |",
                flush=True,
            )
            print("  point by point:", np.round(mean / other, 3), file=sys.stderr)


if __name__ == "__main__":
    main()
