#!/usr/bin/env python3
"""Direct illuminance of luminaires of ies2rad and of spotlights, by bdpm and by Radiance's `rtrace`.

    python3 -m venv VENV && VENV/bin/pip install pyradiance==1.3.1 numpy
    cargo build --release
    VENV/bin/python scripts/radiance_lamps.py [--time 5] [FILE.ies ...]

Without files: those of tests/data. ies2rad converts each file, and the lamp hangs 1.5 m above black ground, as it is
and turned. `rtrace -I+ -ab 0` divides the lamp finely (-ds .02 -dj 0). Radiance counts the light of cylinders by their
largest projected area; for lamps with one, it hits a glow with 400,000 random rays instead (-ab 1). Spotlights have
short directions, because the length lowers the light in Radiance. They are also compared with a sum over 400,000 points
of the lamp, because rtrace does not divide lamps at the edge of a cone finely enough. For each lamp: the mean and range
of the ratio of the illuminance at 16 points, and the largest half-width of the intervals of bdpm. The program is target/release/bdpm, or the
one that the environment variable BDPM names.
"""

import argparse
import json
import re
import tempfile
from pathlib import Path

import numpy
from radiance_scenes import BDPM, LUMENS, run

ROOT = Path(__file__).resolve().parent.parent

GROUND = "void plastic ground 0 0 5 0 0 0 0 0\nground polygon g 0 0 12 -9 -9 0 9 -9 0 9 9 0 -9 9 0\n"
SPOTS = {
    "spotlight, disc along it": "7 500 500 500 60 0 0 -1e-4|ring lamp 0 0 8 0 0 0 0 0 -1 0 .1",
    "spotlight, disc aslant": "7 500 500 500 60 3e-5 0 -1e-4|ring lamp 0 0 8 0 0 0 0 0 -1 0 .1",
    "spotlight, square": "7 500 500 500 40 -1e-5 1e-5 -1e-4|polygon lamp 0 0 12 -.1 -.1 0 -.1 .1 0 .1 .1 0 .1 -.1 0",
    "spotlight, ball": "7 500 500 500 70 2e-5 0 -1e-4|sphere lamp 0 0 4 0 0 0 .05",
}
POINTS = [(x, y, 0, 0, 0, 1) for x in (-1.1, -0.35, 0.4, 1.15) for y in (-0.9, -0.25, 0.3, 1.05)]


def by_radiance(scene):
    """Direct illuminance at each point, lux."""
    lamps = [own for own in scene.parent.glob("*.rad") if own != scene and own.name in scene.read_text()]
    has_cylinder = any(" cylinder " in own.read_text() for own in lamps)
    if has_cylinder:
        for lamp in lamps:
            text = re.sub(r"\blight ('.*')\n0\n0\n3 1 1 1", r"glow \1\n0\n0\n4 1 1 1 0", lamp.read_text())
            (lamp.parent / f"glow_{lamp.name}").write_text(text)
        glowing = scene.with_name("glowing.rad")
        glowing.write_text(scene.read_text().replace(lamps[0].name, f"glow_{lamps[0].name}"))
        scene = glowing
    octree = scene.with_suffix(".oct")
    octree.write_bytes(run(["oconv", scene.name], folder=scene.parent))
    options = "-h -I+ -ab 0 -ds .02 -dj 0 -dt 0 -dc 1 -dr 0".split()
    if has_cylinder:
        options = "-h -I+ -ab 1 -aa 0 -ad 400000 -lw 1e-9 -as 0".split()
    text = "".join(" ".join(map(str, point)) + "\n" for point in POINTS).encode()
    out = run(["rtrace", *options, octree.name], text, scene.parent).decode().split()
    return numpy.array(out, float).reshape(-1, 3) @ LUMENS


def by_sum(name):
    """Direct illuminance of a spotlight at each point, lux."""
    material, surface = SPOTS[name].split("|")
    *_, radiance, degrees, x, y, z = map(float, material.split()[1:])
    aim = numpy.array([x, y, z]) / numpy.linalg.norm([x, y, z])
    u, v = numpy.random.default_rng(1).random((2, 400_000))
    if surface.startswith("ring"):
        across = 0.1 * u**0.5
        at, area = across * numpy.array([numpy.cos(2 * numpy.pi * v), numpy.sin(2 * numpy.pi * v)]), 0.01 * numpy.pi
        normals = numpy.array([[0, 0, -1]])
    elif surface.startswith("polygon"):
        at, area, normals = numpy.array([0.2 * u - 0.1, 0.2 * v - 0.1]), 0.04, numpy.array([[0, 0, -1]])
    else:
        height, turn = 2 * u - 1, 2 * numpy.pi * v
        across = (1 - height**2) ** 0.5
        normals = numpy.array([across * numpy.cos(turn), across * numpy.sin(turn), height]).T
        at, area = None, 0.01 * numpy.pi
    start = 0.05 * normals if at is None else numpy.array([*at, 0 * u]).T
    lux = []
    for point in POINTS:
        to = numpy.array(point[:3]) - start - [0, 0, 1.5]
        distance = numpy.linalg.norm(to, axis=1)
        to /= distance[:, None]
        cosines = (to * normals).sum(axis=1).clip(0) * -to[:, 2]
        lux.append(179 * radiance * area * numpy.mean((to @ aim > numpy.cos(numpy.radians(degrees / 2))) * cosines / distance**2))
    return numpy.array(lux)


def by_bdpm(scene, points, seconds):
    """Illuminance at each point, lux, and the half-width of its interval."""
    meters = scene.with_suffix(".pts")
    meters.write_text("".join(" ".join(map(str, point)) + "\n" for point in points))
    command = [BDPM, "measure", str(scene), "--meters", str(meters), "--time", f"{seconds:g}s", "--json", "--quiet"]
    report = json.loads(run(command))
    values = [own["readings"][0] for own in report["meters"]]
    return numpy.array([own["value"] for own in values]), numpy.array([own["expanded"] for own in values])


def scenes(folder, files):
    """Names and texts of all lamps around the origin."""
    for path in files:
        try:
            run(["ies2rad", "-dm", "-o", path.stem, str(path.resolve())], folder=folder)
        except RuntimeError as error:
            print(f"# {path.name}: {error}")
            continue
        yield path.stem, f"!xform -t 0 0 1.5 {path.stem}.rad\n"
        yield f"{path.stem}, turned", f"!xform -rx 25 -rz 40 -t .1 .2 1.5 {path.stem}.rad\n"
    for name, text in SPOTS.items():
        numbers, surface = text.split("|")
        (folder / "spot.rad").write_text(f"void spotlight spot 0 0 {numbers}\nspot {surface}\n")
        yield name, "!xform -t 0 0 1.5 spot.rad\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--time", type=float, default=5.0)
    own = parser.parse_args()
    files = own.files or sorted((ROOT / "tests/data").glob("**/*.ies"))
    print("| lamp | by | lit points | lux | mean ratio | range | largest half-width |\n|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, text in scenes(Path(folder), files):
            scene = Path(folder) / "scene.rad"
            scene.write_text(GROUND + text)
            references = {"rtrace": by_radiance(scene)}
            if name in SPOTS:
                references["a sum"] = by_sum(name)
            for by, theirs in references.items():
                lit = theirs > 1e-3 * theirs.max()
                ours, width = by_bdpm(scene, [point for point, lights in zip(POINTS, lit) if lights], own.time)
                ratio = ours / theirs[lit]
                print(
                    f"| {name} | {by} | {lit.sum()} | {theirs[lit].min():.4g} to {theirs.max():.4g} | {ratio.mean():.4f} "
                    f"| {ratio.min():.4f} to {ratio.max():.4f} | {100 * (width / ours).max():.2f} % |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
