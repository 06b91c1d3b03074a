"""Time that Mitsuba's `path` takes for the error of an image of scenes/diamond-ring.

    target/mitsuba/bin/python scripts/dispersion_time.py IMAGE.exr SECONDS [--seconds 100] [--samples 16]

IMAGE.exr is what `bdpm render` wrote after SECONDS, at a size that Mitsuba can render well in a short time. Mitsuba 3.9.1 has
no dispersive dielectrics. It renders one image for each of some wavelengths, with the index of glass there. The images
are added with the colors of the parts of the spectrum, as if a spectral path tracer drew wavelengths in strata.

Errors are RMS errors of the luminance, each pixel relative to the root of L^2 + 0.01 mean(L)^2. L is from the image of the
other program: a pixel that is too bright by rare light would hide its own error. The error of Mitsuba is from the scatter
of its runs. That of IMAGE.exr is its difference from the mean of these, less their variance. The time for equal errors
follows from the law of error and samples: time ~ 1/error^2.
"""

import argparse
import time
import tomllib
from pathlib import Path

import mitsuba as mi
import numpy as np
import OpenEXR

from dispersion_check import LUMINANCE, colors

ROOT = Path(__file__).resolve().parent.parent
RUNS = 8
SCENE = ROOT / "scenes" / "diamond-ring"
# Sellmeier's B and C (micrometers squared) of diamond by Peter (1923), as in crates/base/src/glasses.rs.
DIAMOND = [(0.3306, 0.175**2), (4.3356, 0.106**2)]


def index_at(nanometers):
    """Refractive index of diamond."""
    square = (nanometers / 1000) ** 2
    return float(np.sqrt(1 + sum(b * square / (square - c) for b, c in DIAMOND)))


def rgb(value):
    return {"type": "rgb", "value": value if isinstance(value, list) else [float(value)] * 3}


def bsdf(material, nanometers):
    kind = material.get("type", "diffuse")
    if kind == "dielectric":
        assert material["ior"] == "diamond"
        return {"type": "dielectric", "int_ior": index_at(nanometers), "ext_ior": 1.0}
    if kind == "metal":
        return {"type": "roughconductor", "material": "Au", "alpha": material["roughness"] ** 2, "distribution": "ggx"}
    assert kind == "diffuse", kind
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(material.get("albedo", 0))}}


def scene(nanometers, size):
    """The scene for Mitsuba, with the index of diamond at this wavelength."""
    file = tomllib.loads((SCENE / "scene.toml").read_text())
    to_world = mi.ScalarTransform4f().look_at
    camera = file["camera"]
    up = [0, 1, 0]
    parts = {
        "type": "scene",
        "sensor": {
            "type": "perspective", "fov": camera["fov_x_deg"], "fov_axis": "x",
            "to_world": to_world(camera["position"], camera["target"], up),
            "film": {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}},
        },
        "environment": {"type": "constant", "radiance": rgb(file["environment"]["radiance"])},
    }
    for mesh in file["mesh"]:
        path = SCENE / mesh["file"]
        lines = path.read_text().splitlines()
        name = next(line.split()[1] for line in lines if line.startswith("usemtl"))
        material = file["materials"][name]
        # Without this Mitsuba makes normals of its own, which round off facets.
        is_flat = not any(line.startswith("vn ") for line in lines)
        shape = {"type": "obj", "filename": str(path), "face_normals": is_flat, "bsdf": bsdf(material, nanometers)}
        if "emission" in material:
            shape["emitter"] = {"type": "area", "radiance": rgb(material["emission"])}
        parts[path.stem] = shape
    return mi.load_dict(parts)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("image", type=Path)
    parser.add_argument("bdpm_seconds", type=float)
    parser.add_argument("--seconds", type=float, default=100)
    parser.add_argument("--samples", type=int, default=16, help="of a pixel and wavelength in one call of Mitsuba")
    parser.add_argument("--reference", type=Path, help="keeps what Mitsuba renders, or takes it from there")
    args = parser.parse_args()
    with OpenEXR.File(str(args.image)) as file:
        ours, albedo = (np.asarray(file.channels()[name].pixels, dtype=np.float64) for name in ("RGB", "albedo"))
        ours = ours @ LUMINANCE
    if args.reference and args.reference.exists():
        runs, seconds = (lambda file: (file["runs"], float(file["seconds"])))(np.load(args.reference))
    else:
        runs, seconds = path_traced(ours.shape[::-1], args.seconds, args.samples)
        if args.reference:
            np.savez(args.reference, runs=runs, seconds=seconds)
    mean, variance = runs.mean(axis=0), runs.var(axis=0, ddof=1) / RUNS
    weight = lambda image: 1 / (image**2 + 0.01 * image.mean() ** 2)  # noqa: E731
    print(f"mean luminance {mean.mean():.4f} by Mitsuba, {ours.mean():.4f} by bdpm")
    # Pixels that show nothing but one diffuse surface.
    materials = tomllib.loads((SCENE / "scene.toml").read_text())["materials"].values()
    is_diffuse = [np.abs(albedo - np.array(one.get("albedo", -1))).max(axis=-1) < 1e-3 for one in materials]
    is_diffuse = np.any(is_diffuse, axis=0)
    everywhere = np.ones_like(is_diffuse)
    for name, pixels in (("all pixels", everywhere), ("diffuse surfaces", is_diffuse), ("the others", ~is_diffuse)):
        theirs2 = (weight(ours) * variance)[pixels].mean()
        ours2 = (weight(mean) * ((ours - mean) ** 2 - variance))[pixels].mean()
        print(
            f"{name}, {100 * pixels.mean():.0f} %: Mitsuba {100 * theirs2**0.5:.2f} % after {seconds:.0f} s, "
            f"bdpm {100 * max(ours2, 0) ** 0.5:.2f} % after {args.bdpm_seconds:g} s; "
            f"Mitsuba takes {seconds * theirs2 / ours2 / args.bdpm_seconds:.3g} times as long for the error of bdpm"
        )


def path_traced(size, least_seconds, samples):
    """Luminances of some runs of Mitsuba, and their time together."""
    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Warn)
    integrator = mi.load_dict({"type": "path", "max_depth": -1, "rr_depth": 5})
    middles, shares = colors()
    scenes = [scene(wavelength, size) for wavelength in middles]
    render = lambda number, seed: np.array(mi.render(scenes[number], integrator=integrator, spp=samples, seed=seed))  # noqa: E731
    for number in range(len(scenes)):
        render(number, 0)  # compiles
    images, seconds, passes = np.zeros((RUNS, size[1], size[0])), 0.0, 0
    while seconds < least_seconds or passes % RUNS > 0:
        start = time.perf_counter()
        for number, color in enumerate(shares):
            image = render(number, 1 + passes * len(scenes) + number)
            images[passes % RUNS] += image[..., :3] @ (color * LUMINANCE)
        seconds += time.perf_counter() - start
        passes += 1
    return images / (passes / RUNS), seconds


if __name__ == "__main__":
    main()
