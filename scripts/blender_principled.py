"""Principled materials of Blender by two materials of bdpm, held against Cycles: docs/measurements/cycles.md.

    target/blender/bin/python scripts/blender_principled.py [CASE...]

A ball fills the image of an orthographic camera, in a white furnace or under a sun from 50 degrees aside. Each row has
the mean luminance of the ball over that of Cycles, less 1, for the material that the add-on exports, and for
`principled` of the same parameters. The program is $BDPM, or else target/release/bdpm.
"""

import os
import re
import subprocess
import sys
import tempfile

import bpy
import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
sys.path[:0] = [os.path.join(ROOT, "blender"), os.path.dirname(os.path.abspath(__file__))]

import bdpm_render  # noqa: E402
import blender_check  # noqa: E402
import blender_elements as elements  # noqa: E402
from bdpm_render import exr  # noqa: E402
from bdpm_render.export.scene import SceneWriter  # noqa: E402

PROGRAM = os.environ.get("BDPM", os.path.join(ROOT, "target/release/bdpm"))
SAMPLES, ITERATIONS, CAMERA_PATHS = 256, 32, 16
COLOR = (0.8, 0.8, 0.8)
# Inputs of Principled, and keys of `principled`.
CASES = {
    f"{kind}, roughness {roughness}": (
        {"Roughness": roughness, **inputs},
        {"roughness": roughness, **keys},
    )
    for kind, inputs, keys in (
        ("dielectric", {}, {}),
        ("metal", {"Metallic": 1.0}, {"metallic": 1.0}),
        ("half a metal", {"Metallic": 0.5}, {"metallic": 0.5}),
        ("transmission", {"Transmission": 1.0}, {"transmission": 1.0}),
        ("coat", {"Clearcoat": 1.0, "Clearcoat_Roughness": 0.0}, {"clearcoat": 1.0, "clearcoat_gloss": 1.0}),
        ("rough coat", {"Clearcoat": 1.0, "Clearcoat_Roughness": 0.3}, {"clearcoat": 1.0, "clearcoat_gloss": 0.1}),
        ("sheen", {"Sheen_Weight": 1.0}, {"sheen": 1.0}),
    )
    for roughness in (0.1, 0.4, 0.8)
}


def build(inputs, light):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module="cycles")
    scene = bpy.context.scene
    blender_check.prepare(scene)
    elements.ball(elements.material(Base_Color=(*COLOR, 1), IOR=1.5, **inputs), location=(0, 0, 0))
    elements.camera((0, 0, 5), (0, 0, 0), type="ORTHO", ortho_scale=2.2)
    if light == "furnace":
        elements.world((1, 1, 1), 1.0)
    else:
        elements.light("SUN", rotation=(0, 0.87, 0), energy=3, angle=0)


def with_principled(text, keys):
    """The scene file with another material."""
    table = {"type": '"principled"', "ior": 1.5, "albedo": list(COLOR), **keys}
    lines = "\n".join(f"{key} = {value}" for key, value in table.items())
    own = re.compile(r"(\[materials\.[^\n]*\]\n).*?(?=\n\[|\Z)", flags=re.S)
    return own.sub(lambda found: found.group(1) + lines + "\n", text)


def render(path):
    image = os.path.join(os.path.dirname(path), "image.exr")
    counts = ["--iterations", str(ITERATIONS), "--camera-paths", str(CAMERA_PATHS)]
    command = [PROGRAM, "render", path, "--output", image, "--strategy", "path", "--quiet", *counts]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return mean(exr.read(image))


def mean(channels):
    """Mean luminance of the ball."""
    gray = sum(weight * channels[letter] for weight, letter in zip((0.2126, 0.7152, 0.0722), "RGB"))
    side = gray.shape[0]
    center = (np.arange(side) + 0.5) / side - 0.5
    inside = np.hypot(*np.meshgrid(center, center)) < 0.98 / 2.2
    return float(gray[inside].mean())


def row(inputs, keys, light, folder):
    build(inputs, light)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples = SAMPLES
    scene.render.filepath = os.path.join(folder, "cycles.exr")
    bpy.ops.render.render(write_still=True)
    judge = mean(exr.read(scene.render.filepath))
    exported = SceneWriter(folder).write(bpy.context.evaluated_depsgraph_get())
    with open(exported.path, encoding="utf-8") as file:
        text = file.read()
    found = [render(exported.path)]
    other = os.path.join(folder, "principled.toml")
    with open(other, "w", encoding="utf-8") as file:
        file.write(with_principled(text, keys))
    found.append(render(other))
    kind = re.search(r"\[materials.*?type = \"(.*?)\"", text, flags=re.S).group(1)
    return judge, kind, [100 * (one / judge - 1) for one in found], exported.remarks


def main():
    bdpm_render.register()
    chosen = sys.argv[1:]
    print(":: | material | light | Cycles | exported as | its mean, % | `principled`, % |")
    for name, (inputs, keys) in CASES.items():
        if chosen and not any(name.startswith(one) for one in chosen):
            continue
        for light in ("furnace", "sun"):
            with tempfile.TemporaryDirectory(prefix="blender-principled-") as folder:
                judge, kind, (own, other), remarks = row(inputs, keys, light, folder)
            print(f":: | {name} | {light} | {judge:.4f} | {kind} | {own:+.2f} | {other:+.2f} |", *remarks, flush=True)


main()
