"""Compares dispersion with Mitsuba, which has no dispersive dielectrics: one image for each of some wavelengths.

    target/mitsuba/bin/python scripts/dispersion_check.py [--bdpm PROGRAM] [--strategy NAME]... [--time 20s]

The virtual environment is that of scripts/mitsuba-check.sh. Mitsuba renders a gray room with the index of glass at the
middle of each part of the spectrum. The images are added with the colors of the parts, by the color matching functions
of the CIE and the illuminant D65 as Mitsuba has them, so that nothing of bdpm's spectrum is used.
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np
import OpenEXR

ROOT = Path(__file__).resolve().parent.parent
PARTS = 32  # of the spectrum, from LOW to HIGH nanometers
LOW, HIGH = 380.0, 780.0
SIZE = 64
# Index at 587.6 nm and Abbe number, more of the BSDF in Mitsuba's words and in bdpm's.
GLASSES = {
    "ball": (1.5, 8.0, "dielectric", "", ""),
    "block": (1.7847, 12.0, "dielectric", "", ""),
    "rough ball": (1.6, 6.0, "roughdielectric", '<float name="alpha" value="0.1"/>', 'alpha = 0.1\nfacets = "beckmann"\n'),
}
BALL = '<shape type="sphere"><point name="center" x="0.15" y="0.1" z="-0.45"/><float name="radius" value="0.4"/>'
BLOCK = """<shape type="cube"><transform name="to_world"><scale x="0.25" y="0.45" z="0.25"/>
    <rotate y="1" angle="35"/><rotate z="1" angle="30"/><translate x="0.1" y="0.1" z="-0.55"/></transform>"""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def xml(name, index):
    """A room of Mitsuba with this index of its glass."""
    _, _, kind, more, _ = GLASSES[name]
    shape = BLOCK if name == "block" else BALL
    return f"""<scene version="3.0.0">
<sensor type="perspective"><float name="fov" value="70"/><string name="fov_axis" value="x"/>
<transform name="to_world"><lookat origin="-0.9,-0.85,0.25" target="0.2,0.2,-0.5" up="0,0,1"/></transform>
<film type="hdrfilm"><integer name="width" value="{SIZE}"/><integer name="height" value="{SIZE}"/><rfilter type="box"/></film>
</sensor>
<bsdf type="twosided" id="gray"><bsdf type="diffuse"><float name="reflectance" value="0.5"/></bsdf></bsdf>
<bsdf type="{kind}" id="glass"><float name="int_ior" value="{index:.9f}"/><float name="ext_ior" value="1"/>{more}</bsdf>
<shape type="cube"><boolean name="flip_normals" value="true"/><ref id="gray"/></shape>
<shape type="rectangle"><transform name="to_world"><scale value="0.35"/><rotate x="1" angle="180"/>
<translate z="0.96"/></transform><bsdf type="diffuse"><float name="reflectance" value="0"/></bsdf>
<emitter type="area"><rgb name="radiance" value="4"/></emitter></shape>
{shape}<ref id="glass"/></shape>
</scene>"""


def index_at(name, nanometers):
    """Cauchy's equation with the index at the line d and the Abbe number."""
    at_d, abbe = GLASSES[name][:2]
    square = lambda wavelength: (wavelength / 1000) ** -2  # noqa: E731
    slope = (at_d - 1) / (abbe * (square(486.1327) - square(656.2725)))
    return at_d + slope * (square(nanometers) - square(587.5618))


def colors():
    """Wavelengths in the middles of the parts, by luminance, and the colors of the parts, which add up to white."""
    fine = np.arange(LOW, HIGH, 0.5) + 0.25
    light = np.array([np.ravel(mi.cie1931_xyz(float(w))) * float(np.ravel(mi.cie_d65(float(w)))[0]) for w in fine])
    to_rgb = np.array([[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]])
    rgb = light @ to_rgb.T
    rgb /= rgb.sum(axis=0)
    parts = np.array_split(np.arange(len(fine)), PARTS)
    middles = [np.average(fine[part], weights=light[part, 1]) for part in parts]
    return middles, [rgb[part].sum(axis=0) for part in parts]


def reference(name, samples):
    """Image and variance by Mitsuba."""
    total, variance = 0.0, 0.0
    integrator = mi.load_dict({"type": "path", "max_depth": -1, "rr_depth": 5})
    for part, (wavelength, color) in enumerate(zip(*colors(), strict=True)):
        scene = mi.load_string(xml(name, index_at(name, wavelength)))
        images = np.array([
            np.array(mi.render(scene, integrator=integrator, spp=samples, seed=4 * part + run)).mean(axis=-1)
            for run in range(4)
        ])
        total = total + images.mean(axis=0)[..., None] * color
        variance = variance + images.var(axis=0, ddof=1)[..., None] / 4 * color**2
    return total, variance


def with_bdpm(program, name, strategy, time, folder):
    """The image of the same room with a dispersive glass."""
    path = Path(folder) / "room.xml"
    path.write_text(xml(name, GLASSES[name][0]))
    room = Path(folder) / name.replace(" ", "-")
    subprocess.run([program, "convert", path, room], check=True, capture_output=True)
    at_d, abbe = GLASSES[name][:2]
    text = (room / "scene.toml").read_text()
    plain = f"ior = {at_d:g}\n"
    assert text.count(plain) == 1, text
    (room / "scene.toml").write_text(text.replace(plain, f"ior = {{ d = {at_d}, abbe = {abbe} }}\n"))
    image = Path(folder) / "image.exr"
    options = ["--time", time, "--strategy", strategy, "--no-denoise", "--json", "--quiet"]
    command = [program, "render", room, "--output", image, *options]
    report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    with OpenEXR.File(str(image)) as file:
        return np.asarray(file.channels()["RGB"].pixels, dtype=np.float64), report["error"]["total"]


def chromaticity(rgb):
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ rgb
    return xyz[:2] / xyz.sum()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bdpm", default=ROOT / "target/release/bdpm")
    parser.add_argument("--strategy", action="append")
    parser.add_argument("--time", default="20s")
    parser.add_argument("--samples", type=int, default=24, help="of each pixel, wavelength and run of Mitsuba")
    args = parser.parse_args()
    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Warn)
    print("| scene | luminance, mean of the image | chromaticity (x, y) | largest of four quarters |\n|---|---|---|---|")
    for name in GLASSES:
        theirs, variance = reference(name, args.samples)
        for strategy in args.strategy or ["single", "path", "mis"]:
            with tempfile.TemporaryDirectory() as folder:
                ours, _ = with_bdpm(args.bdpm, name, strategy, args.time, folder)
            mean = lambda image: image.mean(axis=(0, 1))  # noqa: E731
            error = np.sqrt((mean(variance) * LUMINANCE**2).sum() / SIZE**2) / (mean(theirs) @ LUMINANCE)
            ratio = mean(ours) @ LUMINANCE / (mean(theirs) @ LUMINANCE) - 1
            x, y = chromaticity(mean(ours)) - chromaticity(mean(theirs))
            half = SIZE // 2
            quarters = [np.s_[i : i + half, j : j + half] for i in (0, half) for j in (0, half)]
            off = [mean(ours[q]) @ LUMINANCE / (mean(theirs[q]) @ LUMINANCE) - 1 for q in quarters]
            moved = [np.abs(chromaticity(mean(ours[q])) - chromaticity(mean(theirs[q]))).max() for q in quarters]
            print(
                f"| {name}, `{strategy}` | {100 * ratio:+.2f} % +- {100 * error:.2f} % | {x:+.4f}, {y:+.4f} "
                f"| {100 * max(np.abs(off)):.1f} %; {max(moved):.4f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
