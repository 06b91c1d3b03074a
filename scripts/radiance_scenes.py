#!/usr/bin/env python3
"""Illuminance in `.rad` scenes by bdpm and by Radiance's `rtrace`, whose programs the wheel `pyradiance` ships.

    python3 -m venv VENV && VENV/bin/pip install pyradiance==1.3.1 numpy
    cargo build --release
    VENV/bin/python scripts/radiance_scenes.py [--time 20] [SCENE.rad=POINTS.pts ...]

Without scenes: rooms that it writes, with lamps, with glass, with a translucent ceiling, below five skies of gensky and
gendaylit, and with a venetian blind as a BSDF of Klems patches, which genBSDF makes of its slats. `rtrace` takes random samples without an irradiance cache (-aa 0), 20 bounces (-ab), in so many runs that
its mean has an error. For each scene: the mean ratio over the points, and the root mean square of z, the difference
over both uncertainties. The program is target/release/bdpm, or the one that the environment variable BDPM names.
"""

import argparse
import json
import os
import subprocess
import tempfile
from pathlib import Path

import numpy
import pyradiance

ROOT = Path(__file__).resolve().parent.parent
BDPM = os.environ.get("BDPM", str(ROOT / "target/release/bdpm"))
FOLDER = Path(pyradiance.__file__).parent
LUMENS = 179 * numpy.array([0.265, 0.670, 0.065])
RUNS = 8

ROOM = """void plastic wall 0 0 5 .6 .6 .6 0 0
void plastic ground 0 0 5 .2 .2 .2 0 0
void plastic shelf 0 0 5 .4 .4 .4 0 0
"""
# Walls of a room of 4 x 6 x 3 m, open to the south by a window of 3 x 1.5 m.
OPEN = ROOM + """wall polygon floor 0 0 12 0 0 0 4 0 0 4 6 0 0 6 0
wall polygon ceiling 0 0 12 0 0 3 0 6 3 4 6 3 4 0 3
wall polygon north 0 0 12 0 6 0 4 6 0 4 6 3 0 6 3
wall polygon west 0 0 12 0 0 0 0 6 0 0 6 3 0 0 3
wall polygon east 0 0 12 4 0 0 4 0 3 4 6 3 4 6 0
wall polygon s1 0 0 12 0 0 0 0 0 3 .5 0 3 .5 0 0
wall polygon s2 0 0 12 3.5 0 0 3.5 0 3 4 0 3 4 0 0
wall polygon s3 0 0 12 .5 0 0 .5 0 .9 3.5 0 .9 3.5 0 0
wall polygon s4 0 0 12 .5 0 2.4 .5 0 3 3.5 0 3 3.5 0 2.4
!genbox shelf table 1.2 .7 .05 | xform -t 1 3 .7
"""
CLOSED = ROOM + "!genbox wall room 4 6 3 -i\n!genbox shelf table 1.2 .7 .05 | xform -t 1 3 .7\n"
LAMP = """void light lamp 0 0 3 60 60 60
!xform -t 1.5 1.5 0 -a 2 -t 0 3 0 lamp.rad
"""
PANEL = "lamp polygon panel 0 0 12 0 0 2.9 0 .6 2.9 1 .6 2.9 1 0 2.9\n"
PANE = "void glass pane 0 0 3 .96 .96 .96\npane polygon window 0 0 12 .5 0 .9 3.5 0 .9 3.5 0 2.4 .5 0 2.4\n"
# Its front faces the room.
BLIND = "void BSDF blind 6 0 blind.xml 0 0 1 . 0 0\nblind polygon window 0 0 12 .5 0 .9 .5 0 2.4 3.5 0 2.4 3.5 0 .9\n"
CLOTH = """void trans cloth 0 0 7 .8 .8 .8 0 0 .6 0
cloth polygon under 0 0 12 .05 .05 2.6 3.95 .05 2.6 3.95 5.95 2.6 .05 5.95 2.6
"""
DOME = """skyfunc glow sky_glow 0 0 4 1 1 1 0
sky_glow source sky 0 0 4 0 0 1 180
skyfunc glow ground_glow 0 0 4 1 1 1 0
ground_glow source below 0 0 4 0 0 -1 180
"""
SKIES = {
    "gensky -c": ["gensky", "6", "21", "11", "-c"],
    "gensky -s": ["gensky", "6", "21", "11", "-s"],
    "gensky -i": ["gensky", "6", "21", "11", "-i"],
    "gensky +s": ["gensky", "6", "21", "11", "+s"],
    "gendaylit": ["gendaylit", "6", "21", "11", "-W", "600", "150"],
}
POINTS = [(x, y, 0.85, 0, 0, 1) for y in (1, 2, 5) for x in (0.8, 2.5, 3.4)]


def run(command, text=None, folder=None):
    environment = dict(os.environ, RAYPATH=f".:{FOLDER / 'lib'}")
    environment["PATH"] = f"{FOLDER / 'bin'}:{environment['PATH']}"
    done = subprocess.run(command, input=text, capture_output=True, env=environment, cwd=folder)
    if done.returncode != 0:
        raise RuntimeError(f"{command[0]}: {done.stderr.decode(errors='replace').strip()}")
    return done.stdout


def by_radiance(scene, points):
    """Illuminance at each point, lux, and its standard error, from independent runs."""
    with tempfile.NamedTemporaryFile(suffix=".oct") as octree:
        materials = scene.with_suffix(".mat")
        files = [str(own.name) for own in (materials, scene) if own.exists()]
        octree.write(run(["oconv", *files], folder=scene.parent))
        octree.flush()
        options = "-h -I -ab 20 -aa 0 -ad 1500 -as 0 -lw 1e-6 -ds .01 -dj .7 -dt 0 -dc 1 -st 0 -u+".split()
        text = "".join(" ".join(map(str, point)) + "\n" for point in points).encode()
        lux = []
        for _ in range(RUNS):
            # With -u+ each run has a random sequence of its own.
            out = run(["rtrace", *options, octree.name], text, scene.parent).decode().split()
            lux.append(numpy.array(out, float).reshape(-1, 3) @ LUMENS)
    lux = numpy.array(lux)
    return lux.mean(axis=0), lux.std(axis=0, ddof=1) / len(lux) ** 0.5


def by_bdpm(scene, points, seconds):
    """Illuminance at each point, lux, and its standard uncertainty."""
    command = [BDPM, "measure", str(scene), "--meters", str(points), "--time", f"{seconds:g}s", "--json", "--quiet"]
    report = json.loads(run(command))
    values = [own["readings"][0] for own in report["meters"]]
    return numpy.array([own["value"] for own in values]), 0.5 * numpy.array([own["expanded"] for own in values])


def blind(folder):
    """The BSDF file of slats of 5 cm, tilted by 30 degrees."""
    os.environ["PATH"] = f"{FOLDER / 'bin'}:{os.environ['PATH']}"
    os.environ.setdefault("RAYPATH", f".:{FOLDER / 'lib'}")
    slats = pyradiance.BlindsGeometry(depth=0.05, width=1, height=1, nslats=20, angle=30)
    paint = pyradiance.ShadingMaterial(diffuse_reflectance=0.6)
    geometry = folder / "slats.rad"
    geometry.write_bytes(pyradiance.generate_blinds_for_bsdf(paint, slats))
    scattered = pyradiance.generate_bsdf(str(geometry), nsamp=200, nproc=2, dim=pyradiance.genbsdf.SamplingBox(0.2, 0.8, 0.2, 0.8, -0.05, 0))
    (folder / "blind.xml").write_bytes(pyradiance.generate_xml(vis_results=scattered))


def scenes(folder):
    """Files of the rooms, with their points."""
    (folder / "lamp.rad").write_text("void light lamp 0 0 3 60 60 60\n" + PANEL)
    blind(folder)
    all = {"lamps": CLOSED + LAMP, "lamps above cloth": CLOSED + LAMP + CLOTH}
    for name, command in SKIES.items():
        sky = run([*command, "-a", "48", "-o", "-9", "-m", "-15"]).decode()
        # South is toward -y.
        all[name] = OPEN + sky + DOME
        if name in ("gensky -c", "gensky +s"):
            all[name + ", blind"] = OPEN + BLIND + sky + DOME
        if name in ("gensky -c", "gensky +s"):
            all[name + ", pane"] = OPEN + PANE + sky + DOME
    for name, text in all.items():
        path = folder / f"{name.replace(' ', '_').replace(',', '')}.rad"
        path.write_text(text)
        points = folder / f"{path.stem}.pts"
        points.write_text("".join(" ".join(map(str, point)) + "\n" for point in POINTS))
        yield name, path, points


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--time", type=float, default=20.0)
    own = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        given = [(Path(text.split("=")[0]).stem, *map(Path, text.split("="))) for text in own.scenes]
        print("| scene | points | lux | bdpm / rtrace | range | rms of z |\n|---|---|---|---|---|---|")
        for name, scene, points in given or scenes(Path(folder)):
            at = [tuple(map(float, line.split())) for line in points.read_text().splitlines() if line.strip()]
            theirs, their_error = by_radiance(scene.resolve(), at)
            ours, our_error = by_bdpm(scene.resolve(), points.resolve(), own.time)
            ratio = ours / theirs
            z = (ours - theirs) / numpy.hypot(our_error, their_error)
            print(
                f"| {name} | {len(at)} | {theirs.min():.3g} to {theirs.max():.3g} | {ratio.mean():.4f} "
                f"| {ratio.min():.3f} to {ratio.max():.3f} | {(z**2).mean() ** 0.5:.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
