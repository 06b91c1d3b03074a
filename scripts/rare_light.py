#!/usr/bin/env python3
"""How often the error that `bdpm render --time` states holds, in scenes whose light is hard to find.

usage: rare_light.py [--bdpm PROGRAM] [--seeds N] [--times S,S] [--reference S] [--threads N] [SCENE...]
       rare_light.py --write FOLDER

Wants OpenEXR and numpy (`pip install OpenEXR numpy`). A SCENE is a file, or one of `park`, `hall` and `window`, which
this script writes: a pool in a park under a sun, a glass on a table in a hall under a spot 30 m away, and a sheet of
glass behind a building. Of each scene, four images of --reference seconds with seeds of their own are the reference,
less its own noise. A row has the number of seeds, the mean stated error, the mean true error, the numbers of true
errors below, in and above the stated interval of 90 %, and the number of renders that say in a note that light may be
missing. Images of a reference are kept beside each other in a temporary folder, and go at the end.
"""

import argparse
import json
import math
import pathlib
import subprocess
import tempfile

import numpy as np
import OpenEXR

# Of linear BT.709 primaries
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
REFERENCES = 4


class Mesh:
    def __init__(self):
        self.points, self.faces = [], []

    def face(self, *points):
        first = len(self.points) + 1
        self.points += points
        self.faces.append(range(first, first + len(points)))

    def box(self, low, high, sides="-x+x-y+y-z+z"):
        """The faces of a box look outward."""
        corner = [[p[i] for p in (low, high)] for i in range(3)]
        for axis, letter in enumerate("xyz"):
            for side, sign in enumerate("-+"):
                if sign + letter not in sides:
                    continue
                across, up = [(axis + 1) % 3, (axis + 2) % 3]
                points = []
                for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                    point = [0, 0, 0]
                    point[axis], point[across], point[up] = corner[axis][side], corner[across][a], corner[up][b]
                    points.append(tuple(point))
                self.face(*(points if side else points[::-1]))
        return self

    def lathe(self, profile, sides=32):
        """A profile of radii and heights, from the axis below to the axis above, turned around z."""

        def point(place, turn):
            radius, height = place
            angle = 2 * math.pi * (turn % sides) / sides
            return (radius * math.cos(angle), radius * math.sin(angle), height)

        for low, high in zip(profile, profile[1:]):
            for turn in range(sides):
                corners = [point(low, turn), point(low, turn + 1), point(high, turn + 1), point(high, turn)]
                self.face(*dict.fromkeys(corners))
        return self

    def write(self, path):
        lines = [f"v {x:.6g} {z:.6g} {-y:.6g}" for x, y, z in self.points]  # up is +y
        lines += ["f " + " ".join(map(str, face)) for face in self.faces]
        path.write_text("\n".join(lines) + "\n")


def scene(folder, name, camera, meshes, materials, lights):
    position, target, fov = camera
    turned = [[p[0], p[2], -p[1]] for p in (position, target)]
    text = f"[camera]\nposition = {turned[0]}\ntarget = {turned[1]}\nfov_y_deg = {fov}\n"
    for mesh, (shape, material) in meshes.items():
        shape.write(folder / f"{name}-{mesh}.obj")
        text += f'[[mesh]]\nfile = "{name}-{mesh}.obj"\nmaterial = "{material}"\n'
    for material, keys in materials.items():
        text += f"[materials.{material}]\n{keys}\n"
    path = folder / f"{name}.toml"
    path.write_text(text + lights + "[render]\nresolution = [96, 72]\n")
    return path


SUN = '[[light]]\ntype = "sun"\ndirection = {}\nirradiance = 3\n[environment]\nradiance = 0.1\n'
GLASS = 'type = "dielectric"\nior = 1.5'


def park(folder):
    basin = Mesh().box((-4, -2, 0.01), (4, 2, 0.02), "+z")
    for low, high in (((-4.3, -2.3, 0), (-4, 2.3, 1)), ((4, -2.3, 0), (4.3, 2.3, 1)), ((-4, -2.3, 0), (4, -2, 1)),
                      ((-4, 2, 0), (4, 2.3, 1))):
        basin.box(low, high)
    meshes = {
        "ground": (Mesh().box((-200, -200, -1), (200, 200, 0), "+z"), "grass"),
        "basin": (basin, "tiles"),
        "water": (Mesh().box((-3.99, -1.99, 0.05), (3.99, 1.99, 0.9)), "water"),
    }
    materials = {"grass": "albedo = 0.2", "tiles": "albedo = 0.6", "water": 'type = "dielectric"\nior = 1.33'}
    camera = ((3, -14, 7), (0, 0, 0.5), 35)
    return scene(folder, "park", camera, meshes, materials, SUN.format([0.5, -1, -0.3]))


def hall(folder):
    profile = [(0, 0.8001), (0.035, 0.8001), (0.035, 0.805), (0.004, 0.81), (0.004, 0.88), (0.03, 0.9), (0.04, 0.94),
               (0.03, 1.0), (0.028, 1.0), (0.038, 0.94), (0.028, 0.902), (0, 0.9)]
    meshes = {
        "hall": (Mesh().box((30, 20, 31), (-30, -20, 0)), "walls"),
        "table": (Mesh().box((-1, -0.6, 0.75), (1, 0.6, 0.8)), "wood"),
        "glass": (Mesh().lathe(profile), "glass"),
        "lamp": (Mesh().box((-25, -15, 30.8), (25, -10, 30.9), "-z"), "lamp"),
    }
    materials = {"walls": "albedo = 0.6", "wood": "albedo = 0.4", "glass": GLASS, "lamp": "albedo = 0\nemission = 1"}
    camera = ((0.5, -1.2, 1.5), (0.05, 0, 0.82), 30)
    spot = '[[light]]\ntype = "spot"\nposition = [8, 30, 3]\ndirection = [-8, -29.2, -3]\nintensity = 2000\n'
    return scene(folder, "hall", camera, meshes, materials, spot + "outer_deg = 3\ninner_deg = 2\n")


def window(folder):
    meshes = {
        "ground": (Mesh().box((-100, -100, -1), (100, 100, 0), "+z"), "ground"),
        "building": (Mesh().box((-5, 0, 0), (5, 10, 8)), "building"),
        "window": (Mesh().box((6, 12, 0.5), (9, 12.02, 6)), "glass"),
    }
    materials = {"ground": "albedo = 0.4", "building": "albedo = 0.5", "glass": GLASS}
    camera = ((4, -25, 6), (4, 5, 1), 35)
    return scene(folder, "window", camera, meshes, materials, SUN.format([0.1, -1, -1]))


WRITERS = {"park": park, "hall": hall, "window": window}


def luminance(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return np.stack([file.channels()[c].pixels for c in "RGB"], axis=-1).astype(np.float64) @ LUMINANCE


def render(options, path, folder, time, seed):
    image = folder / "image.exr"
    command = [options.bdpm, "render", path, "--time", f"{time}s", "--seed", seed, "--threads", options.threads]
    command += ["--no-denoise", "--layers", "none", "--json", "--output", image]
    run = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    if not run.stdout:
        raise SystemExit(run.stderr)
    # Notes of the light that the choices or the audit miss; those of the reader are about files
    notes = [line for line in run.stderr.splitlines() if line.startswith(("note", "warning"))]
    return luminance(image), json.loads(run.stdout)["error"], notes


def rows(options, path, folder):
    long = [render(options, path, folder, options.reference, 1000 + seed)[0] for seed in range(REFERENCES)]
    reference = np.mean(long, axis=0)
    name, mean = pathlib.Path(path).stem, reference.mean()
    # Those of `bdpm compare`: theory.md (95)
    weights = 1 / (reference**2 + 0.01 * mean**2)
    variance = np.mean(weights * np.var(long, axis=0, ddof=1)) / REFERENCES
    print(f"# {name}: relative error of the reference {math.sqrt(variance):.2%}", flush=True)
    for time in options.times.split(","):
        stated, true, places, open_notes, texts = [], [], {"below": 0, "in": 0, "above": 0}, 0, set()
        for seed in range(1, options.seeds + 1):
            image, error, notes = render(options, path, folder, time, seed)
            own = math.sqrt(max(np.mean(weights * (image - reference) ** 2) - variance, 0))
            interval = error.get("interval") or {}
            low, high = interval.get("low"), interval.get("high")
            texts.update(notes)
            open_notes += bool(notes)
            place = "above" if high is not None and own > high else "below" if low is not None and own < low else "in"
            places[place] += 1
            true.append(own)
            stated.append(error["total"])
        means = [f"{100 * np.mean(of):.2f} %" for of in (stated, true)]
        cells = [name, f"{time} s", options.seeds, *means, *places.values(), open_notes]
        print("| " + " | ".join(map(str, cells)) + " |", flush=True)
        for text in sorted(texts):
            print(f"# {text}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bdpm", default="target/release/bdpm")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--times", default="3,10")
    parser.add_argument("--reference", type=float, default=60)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--write", type=pathlib.Path, metavar="FOLDER")
    parser.add_argument("scenes", nargs="*", default=list(WRITERS))
    options = parser.parse_args()
    if options.write:
        options.write.mkdir(parents=True, exist_ok=True)
        for writer in WRITERS.values():
            print(writer(options.write))
        return
    print("| scene | time | seeds | stated | true | below | in | above | with a note |\n" + "|---" * 9 + "|")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for given in options.scenes:
            rows(options, WRITERS[given](folder) if given in WRITERS else given, folder)


main()
