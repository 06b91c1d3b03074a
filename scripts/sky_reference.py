"""Writes the reference values of tests/data/sky, by mitsuba==3.9.1 and by gendaylit and gensky of pyradiance.

    python3 scripts/sky_reference.py     with the wheels mitsuba==3.9.1, pyradiance and numpy

mitsuba.tsv: for each sky its parameters, then R G B in 2500 directions and at the center of the sun. radiance.tsv: skies
of gendaylit (`-W direct diffuse -O 1`) and gensky (`-B diffuse`) with the radiance in 500 directions, by the functions of
perezlum.cal and skybright.cal without their ground. All directions are in a frame with +z up, as both programs have it.
"""

import os
import re
import subprocess
from pathlib import Path

import mitsuba as mi
import numpy as np
import pyradiance

ROOT = Path(__file__).resolve().parent.parent / "tests/data/sky"
BIN = Path(pyradiance.__file__).parent / "bin"
COUNT = 2500  # directions of each sky
RADIANCE_COUNT = 500
SKIES = [  # turbidity, albedo, elevation and azimuth of the sun, degrees
    (1.0, (0.0, 0.0, 0.0), 8.0, 30.0),
    (3.0, (0.3, 0.3, 0.3), 45.0, 200.0),
    (6.4, (0.1, 0.5, 0.9), 75.0, 100.0),
    (10.0, (1.0, 1.0, 1.0), 20.0, 300.0),
]
PEREZ = [  # altitude and azimuth of the sun, direct and diffuse irradiance
    (40.0, 30.0, 500.0, 100.0),
    (25.0, -60.0, 50.0, 150.0),
    (60.0, 0.0, 0.0, 200.0),
    (15.0, 80.0, 700.0, 60.0),
]
CIE = [("-c", 1), ("-s", 12), ("-u", 5)]


def directions(count):
    """A Fibonacci lattice over the hemisphere, which the tests compute as well."""
    index = np.arange(count)
    z = (index + 0.5) / count
    azimuth = np.pi * (3 - 5**0.5) * index
    across = np.sqrt(1 - z * z)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=-1)


def sun(elevation, azimuth):
    e, a = np.radians([elevation, azimuth])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def mitsuba():
    mi.set_variant("scalar_rgb")
    with open(ROOT / "mitsuba.tsv", "w") as out:
        for turbidity, albedo, elevation, azimuth in SKIES:
            toward = sun(elevation, azimuth)
            emitter = mi.load_dict({
                "type": "sunsky", "turbidity": turbidity, "sun_direction": toward.tolist(),
                "albedo": {"type": "rgb", "value": list(albedo)},
            })
            out.write("sky\t" + "\t".join(f"{x:.6f}" for x in (turbidity, *albedo, *toward)) + "\n")
            # The center of the sun is last.
            for direction in [*directions(COUNT), toward]:
                si = mi.SurfaceInteraction3f()
                si.wi = mi.Vector3f(*(-direction).tolist())
                color = np.array(emitter.eval(si))
                out.write("\t".join(f"{x:.5g}" for x in color) + "\n")


def brightness_function(command):
    """Arguments of the last brightfunc that a generator of skies writes, and the radiance of its sun."""
    run = subprocess.run([str(BIN / command[0]), *command[1:]], capture_output=True, text=True, check=True)
    words = run.stdout.split()
    at = words.index("skyfunc")
    numbers = [float(word) for word in words[at + 6 : at + 6 + int(words[at + 5])]]
    lit = re.search(r"void light solar\n0\n0\n3 (\S+)", run.stdout)
    solar = float(lit.group(1)) if lit else 0.0
    return numbers, solar


def perez_lum(numbers, direction):
    scale, _, a, b, c, d, e, *toward = numbers
    z = np.maximum(direction[:, 2], 0.01)
    cosine = np.clip(direction @ np.array(toward), -1, 1)
    return scale * (1 + a * np.exp(b / z)) * (1 + c * np.exp(d * np.arccos(cosine)) + e * cosine**2)


def sky_bright(numbers, direction):
    kind, zenith = numbers[:2]
    z = direction[:, 2]
    if kind == 2:
        return zenith * (1 + 2 * z) / 3
    if kind == 3:
        return zenith + 0 * z
    factor, *toward = numbers[3:]
    cosine = np.clip(direction @ np.array(toward), -1, 1)
    around = 0.91 + 10 * np.exp(-3 * np.arccos(cosine)) + 0.45 * cosine**2
    return zenith * around * np.where(z > 0.01, 1 - np.exp(-0.32 / np.maximum(z, 0.01)), 1) / factor


def radiance():
    with open(ROOT / "radiance.tsv", "w") as out:
        def write(head, toward, solar, values):
            out.write("\t".join([*head, *(f"{x:.6f}" for x in toward), f"{solar:.4g}"]) + "\n")
            out.writelines(f"{value:.6g}\n" for value in values)

        some = directions(RADIANCE_COUNT)

        for altitude, azimuth, direct, diffuse in PEREZ:
            command = ["gendaylit", "-ang", altitude, azimuth, "-W", direct, diffuse, "-O", 1]
            numbers, solar = brightness_function([str(one) for one in command])
            head = ["perez", str(direct), str(diffuse)]
            write(head, numbers[-3:], solar, perez_lum(numbers, some))
        for option, kind in CIE:
            command = ["gensky", "-ang", 50, 20, option, "-B", 100]
            numbers, _ = brightness_function([str(one) for one in command])
            toward = numbers[-3:] if len(numbers) == 7 else sun(50, 250)
            write(["cie", str(kind), "100"], toward, 0.0, sky_bright(numbers, some))


if __name__ == "__main__":
    os.environ["RAYPATH"] = str(BIN.parent / "lib")
    ROOT.mkdir(parents=True, exist_ok=True)
    mitsuba()
    radiance()
