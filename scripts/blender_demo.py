"""A glass and a ring on a table under a small lamp, as a file of Blender:

    blender --background --python scripts/blender_demo.py -- OUT.blend

With `--compare SECONDS` it is also rendered for so long by the add-on and by Cycles, as OUT-bdpm.exr and
OUT-cycles.exr, and held against references of `--reference SECONDS` by either, which are kept. `--picture FILE.jpg`
puts both side by side, with labels, by the program of examples/picture.rs that the variable PICTURE names.
"""

import argparse
import math
import os
import subprocess
import sys
import time

import bpy
import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
sys.path[:0] = [os.path.join(ROOT, "blender")]
SIDES = 96
# Radius and height of a glass that is full to the brim, from the middle of its foot to that of the brim, m.
OUTSIDE = [(0, 0), (0.036, 0), (0.037, 0.002), (0.02, 0.006), (0.006, 0.012), (0.006, 0.022), (0.008, 0.028)]
BOWL = [(0.02, 0.036), (0.034, 0.054), (0.038, 0.076), (0.036, 0.1)]
BRIM = [(0.0355, 0.1005), (0, 0.1005)]


def smooth(points, count):
    """A polyline through the points, by Catmull and Rom."""
    points = np.array([points[0], *points, points[-1]], float)
    parts = []
    for a, b, c, d in zip(points, points[1:], points[2:], points[3:]):
        t = np.linspace(0, 1, count, endpoint=False)[:, None]
        parts.append(0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3))
    return np.concatenate([*parts, points[-1:]])


def lathe(name, profile):
    """A mesh of a profile of (radius, height) that begins and ends at the axis."""
    profile = np.array([(max(radius, 0.0), height) for radius, height in profile])
    inner = profile[1:-1]
    turns = np.arange(SIDES) * (2 * math.pi / SIDES)
    rings = np.stack([np.outer(inner[:, 0], np.cos(turns)), np.outer(inner[:, 0], np.sin(turns))], axis=-1)
    heights = np.broadcast_to(inner[:, 1, None, None], (len(inner), SIDES, 1))
    positions = np.concatenate([rings, heights], axis=-1).reshape(-1, 3).tolist()
    positions += [(0, 0, profile[0, 1]), (0, 0, profile[-1, 1])]
    start, end = len(positions) - 2, len(positions) - 1
    faces = []
    for k in range(SIDES):
        n = (k + 1) % SIDES
        faces.append((start, n, k))
        for ring in range(len(inner) - 1):
            a, b = ring * SIDES, (ring + 1) * SIDES
            faces.append((a + k, a + n, b + n, b + k))
        faces.append((end, len(inner) * SIDES - SIDES + k, len(inner) * SIDES - SIDES + n))
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(positions, [], faces)
    mesh.polygons.foreach_set("use_smooth", [True] * len(faces))
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made


def material(name, **inputs):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"]
    for key, value in inputs.items():
        key = key.replace("_", " ")
        renamed = {"Transmission": "Transmission Weight", "Specular": "Specular IOR Level"}.get(key, key)
        shader.inputs[key if key in shader.inputs else renamed].default_value = value
    return made


def make_scene():
    """Builds it into an empty file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    glass = lathe("Glass", smooth(OUTSIDE + BOWL, 8).tolist() + BRIM)
    glass.location = (0, 0, 0.0005)
    glass.data.materials.append(material("Glass", Base_Color=(1, 1, 1, 1), Transmission=1.0, Roughness=0.0, IOR=1.4))
    bpy.ops.mesh.primitive_torus_add(
        major_radius=0.035, minor_radius=0.004, major_segments=128, minor_segments=32, location=(0.1, 0.03, 0.01)
    )
    bpy.ops.object.shade_smooth()
    bpy.context.object.scale.z = 2.5
    bpy.context.object.data.materials.append(
        material("Gold", Base_Color=(0.95, 0.7, 0.3, 1), Metallic=1.0, Roughness=0.1)
    )
    bpy.ops.mesh.primitive_plane_add(size=0.9)
    bpy.context.object.data.materials.append(
        material("Table", Base_Color=(0.5, 0.42, 0.35, 1), Roughness=1.0, Specular=0.0)
    )
    bpy.ops.object.light_add(type="POINT", location=(-0.25, 0.3, 0.5))
    bpy.context.object.data.energy, bpy.context.object.data.shadow_soft_size = 8, 0.012
    bpy.ops.object.camera_add(location=(0.22, -0.33, 0.3), rotation=(math.radians(55), 0, math.radians(28)))
    scene.camera = bpy.context.object
    scene.camera.data.lens = 55
    world = scene.world or bpy.data.worlds.new("World")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.03, 0.035, 0.045, 1)
    scene.world = world
    scene.render.resolution_x, scene.render.resolution_y = 480, 360
    scene.view_settings.view_transform = "Standard"
    return scene


def read_pixels(path):
    from bdpm_render import exr

    channels = exr.read(path)
    return np.stack([channels[letter] for letter in "RGB"], axis=-1).astype(np.float64)


def as_exr(scene):
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "IMAGE"
    image.file_format, image.color_mode, image.color_depth, image.exr_codec = "OPEN_EXR", "RGB", "32", "ZIP"


def render(scene, engine, seconds, path, threads):
    """Pixels after so much time; Cycles has all caustics on, and no bounds."""
    scene.render.engine = engine
    if threads:
        scene.render.threads_mode, scene.render.threads, scene.bdpm.threads = "FIXED", threads, threads
    scene.bdpm.use_error, scene.bdpm.use_time, scene.bdpm.time = False, True, seconds
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.time_limit = "CPU", 1 << 24, seconds
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.sample_clamp_indirect = cycles.sample_clamp_direct = cycles.blur_glossy = 0
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.max_bounces = cycles.transmission_bounces = cycles.glossy_bounces = cycles.diffuse_bounces = 32
    scene.render.filepath = path
    start = time.monotonic()
    bpy.ops.render.render(write_still=True)
    print(f":: {engine} took {time.monotonic() - start:.1f} s", flush=True)
    return read_pixels(path)


def relative_errors(image, reference, shares):
    """Roots of the mean squared differences, relative to sqrt(L^2 + 0.01 mean(L)^2) of the reference, over these
    shares of the pixels, the best ones."""
    weights = np.array([0.2126, 0.7152, 0.0722])
    a, b = image @ weights, reference @ weights
    squares = np.sort(((a - b) ** 2 / (b**2 + 0.01 * b.mean() ** 2)).reshape(-1))
    return [math.sqrt(squares[: int(share * len(squares))].mean()) for share in shares]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("out")
    parser.add_argument("--compare", type=float, help="seconds of each image")
    parser.add_argument("--reference", type=float, default=600, help="seconds of each reference")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--picture", help="a labeled picture of both images; needs --compare")
    given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    options = parser.parse_args(given)
    if options.picture and not (options.compare and os.environ.get("PICTURE")):
        parser.error("--picture needs --compare, and the variable PICTURE with the program of examples/picture.rs")
    scene = make_scene()
    stem = os.path.abspath(os.path.splitext(options.out)[0])
    bpy.ops.wm.save_as_mainfile(filepath=stem + ".blend")
    if options.compare:
        compare(scene, stem, options)


def compare(scene, stem, options):
    import bdpm_render
    from bdpm_render import engine

    bpy.ops.preferences.addon_enable(module="cycles")
    bdpm_render.register()
    if os.environ.get("BDPM"):
        engine.program_path = lambda: os.environ["BDPM"]
    as_exr(scene)
    names = {"BDPM": "bdpm", "CYCLES": "cycles"}
    references = {}
    for kind, name in names.items():
        path = f"{stem}-{name}-reference.exr"
        known = os.path.exists(path)
        references[kind] = read_pixels(path) if known else render(scene, kind, options.reference, path, options.threads)
    # Other random numbers than those of the references.
    scene.bdpm.seed, scene.cycles.seed = 7, 7
    strip = []
    for kind, name in names.items():
        image = render(scene, kind, options.compare, f"{stem}-{name}.exr", options.threads)
        for of, reference in references.items():
            shares = (1, 0.999, 0.5)
            errors = " ".join(f"{100 * error:.1f}" for error in relative_errors(image, reference, shares))
            ratio = 100 * (image.mean() / reference.mean() - 1)
            print(f":: {kind}: relative error {errors} % of {shares} against {of}, mean {ratio:+.2f} %", flush=True)
        # Both are held against the reference of bdpm, as in docs/measurements/cycles.md.
        whole, _, half = relative_errors(image, references["BDPM"], shares)
        program = "bdpm" if kind == "BDPM" else f"Cycles {bpy.app.version_string}"
        label = f"{program}, {options.compare:g} s: error {100 * whole:.0f} %, better half {100 * half:.1f} %"
        strip += [f"{stem}-{name}.exr", label]
    if options.picture:
        subprocess.run([os.environ["PICTURE"], "strip", options.picture, *strip], check=True)


if __name__ == "__main__":
    main()
