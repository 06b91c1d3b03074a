"""Public interiors as users of Blender and of glTF have them: every surface is a Principled BSDF.

    python principled_rooms.py [--maps] [--compare SECONDS] [--reference SECONDS] [--resolution WxH] FOLDER/room.xml...

Runs in Blender as a Python module (`pip install bpy numpy`). A room is a scene of Mitsuba as scripts/interior_scenes.py
writes it, with its meshes (OBJ), rectangles, disks, area lights and environment. Beside each, room.blend and room.glb
are written (room-maps with --maps). Of what the room says, this changes:

- diffuse surfaces have a roughness of .5, which is that of a new material in Blender,
- plastics have the roughness sqrt(alpha) and their index of refraction, metals are metallic with the reflectance at
  normal incidence, glass transmits,
- the picture of a color and masks stay; bumps, black backs and other emitters are left out,
- the map of an environment is not turned,
- with --maps, surfaces with a picture also get a map of their roughness and one of normals, as bought materials have
  them: the picture's luminance, stretched to .2 to .8, and its slopes.

With --compare, the room of Blender is rendered twice for so long by the add-on and by Cycles, and their relative squared
errors are printed against references of --reference seconds by either. The variable BDPM names the program.
"""

import argparse
import math
import os
import pathlib
import sys
import time
import xml.etree.ElementTree as tree

import bpy
import numpy as np
from mathutils import Matrix

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "blender")]
# Mitsuba's y is up, Blender's z.
TURN = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def value(element, name, default=None):
    """The text of a property."""
    return next((child.get("value") for child in element if child.get("name") == name), default)


def color(element, name, default):
    """Three numbers of a property."""
    text = value(element, name)
    numbers = [float(part) for part in text.replace(",", " ").split()] if text else list(default)
    return np.array(numbers * 3 if len(numbers) == 1 else numbers)


def to_world(element):
    matrix = Matrix.Identity(4)
    for child in element.findall("transform/matrix"):
        numbers = [float(part) for part in child.get("value").split()]
        matrix = Matrix([numbers[row * 4 : row * 4 + 4] for row in range(4)]) @ matrix
    return TURN @ matrix


def surface(element):
    """The innermost surface, and the mask around it."""
    mask = None
    while element.get("type") in ("twosided", "mask"):
        if element.get("type") == "mask":
            mask = element
        element = element.find("bsdf")
    return element, mask


class Room:
    """Builds the scene of Blender."""

    def __init__(self, path, has_maps):
        self.has_maps = has_maps
        self.folder = path.parent
        self.root = tree.parse(path).getroot()
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.scene = bpy.context.scene
        self.materials = {own.get("id"): self.material(own, own.get("id")) for own in self.root.findall("bsdf")}
        for number, shape in enumerate(self.root.findall("shape")):
            self.add_shape(shape, f"shape {number}")
        self.add_world()
        self.add_camera()

    def picture(self, nodes, texture, is_color=True):
        name = value(texture, "filename")
        node = nodes.new("ShaderNodeTexImage")
        node.image = bpy.data.images.load(str((self.folder / name).resolve()), check_existing=True)
        if not is_color:
            node.image.colorspace_settings.name = "Non-Color"
        return node

    def material(self, element, name, radiance=None):
        made = bpy.data.materials.new(name or "plain")
        made.use_nodes = True
        nodes, links = made.node_tree.nodes, made.node_tree.links
        shader = next(node for node in nodes if node.type == "BSDF_PRINCIPLED").inputs
        inner, mask = surface(element) if element is not None else (None, None)
        if inner is not None:
            self.set_surface(inner, shader, nodes, links)
        if mask is not None and mask.find("texture") is None:
            shader["Alpha"].default_value = float(color(mask, "opacity", [1]).mean())
        elif mask is not None:
            node = self.picture(nodes, mask.find("texture"), is_color=False)
            links.new(node.outputs["Alpha" if node.image.depth == 32 else "Color"], shader["Alpha"])
        if radiance is not None:
            largest = radiance.max()
            shader["Emission Color"].default_value = (*(radiance / largest), 1)
            shader["Emission Strength"].default_value = float(largest)
        return made

    def set_surface(self, inner, shader, nodes, links):
        kind = inner.get("type")
        alpha = float(value(inner, "alpha", "0"))
        reflected = {"diffuse": "reflectance"}.get(kind, "diffuseReflectance")
        texture = next((own for own in inner.findall("texture") if own.get("name") == reflected), None)
        if texture is not None:
            node = self.picture(nodes, texture)
            links.new(node.outputs["Color"], shader["Base Color"])
        base = color(inner, reflected, [0.5])
        roughness = 0.5 if kind == "diffuse" else math.sqrt(alpha)
        if kind in ("conductor", "roughconductor"):
            shader["Metallic"].default_value = 1
            base = np.ones(3)
            if value(inner, "eta"):
                eta, k = color(inner, "eta", [1]), color(inner, "k", [1])
                base = ((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2)
            base = base * color(inner, "specularReflectance", [1])
        elif kind in ("dielectric", "thindielectric", "roughdielectric"):
            shader["Transmission Weight"].default_value = 1
            base = np.ones(3)
        shader["Base Color"].default_value = (*base, 1)
        shader["Roughness"].default_value = roughness
        shader["IOR"].default_value = float(value(inner, "intIOR", "1.5"))
        if texture is not None and self.has_maps:
            self.add_maps(node.image, shader, nodes, links)

    def add_maps(self, image, shader, nodes, links):
        width, height = image.size
        pixels = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(pixels)
        gray = pixels.reshape(height, width, 4)[:, :, :3] @ LUMINANCE
        low, high = gray.min(), max(gray.max(), gray.min() + 1e-6)
        rough = 0.2 + 0.6 * (gray - low) / (high - low)
        slopes = [8 * (np.roll(rough, -1, axis) - rough) for axis in (1, 0)]
        bent = np.stack([-slopes[0], -slopes[1], np.ones_like(rough)], axis=-1)
        bent = 0.5 + 0.5 * bent / np.linalg.norm(bent, axis=-1, keepdims=True)
        stem = pathlib.Path(image.filepath).stem
        for name, values in (("roughness", np.repeat(rough[:, :, None], 3, axis=2)), ("normals", bent)):
            node = nodes.new("ShaderNodeTexImage")
            node.image = self.written(f"{stem}-{name}.png", values)
            if name == "roughness":
                links.new(node.outputs["Color"], shader["Roughness"])
                continue
            turned = nodes.new("ShaderNodeNormalMap")
            links.new(node.outputs["Color"], turned.inputs["Color"])
            links.new(turned.outputs["Normal"], shader["Normal"])

    def written(self, name, values):
        """An image of these numbers, as a file beside the room."""
        if name in bpy.data.images:
            return bpy.data.images[name]
        height, width = values.shape[:2]
        made = bpy.data.images.new(name, width, height, is_data=True)
        made.pixels.foreach_set(np.dstack([values, np.ones((height, width))]).astype(np.float32).reshape(-1))
        made.filepath_raw, made.file_format = str((self.folder / name).resolve()), "PNG"
        made.save()
        return made

    def add_shape(self, shape, name):
        kind = shape.get("type")
        if kind == "obj":
            path = str((self.folder / value(shape, "filename")).resolve())
            bpy.ops.wm.obj_import(filepath=path, forward_axis="Y", up_axis="Z", use_split_objects=False)
            made = bpy.context.selected_objects[0]
            made.data.shade_flat() if value(shape, "faceNormals") == "true" else made.data.shade_smooth()
        elif kind == "rectangle":
            made = self.flat(name, [(-1, -1), (1, -1), (1, 1), (-1, 1)])
        elif kind == "disk":
            turns = [2 * math.pi * k / 64 for k in range(64)]
            made = self.flat(name, [(math.cos(turn), math.sin(turn)) for turn in turns])
        else:
            print(f":: left out a {kind}", flush=True)
            return
        made.matrix_world = to_world(shape)
        made.data.materials.clear()
        ref, own, light = shape.find("ref"), shape.find("bsdf"), shape.find("emitter")
        if light is not None:
            radiance = color(light, "radiance", [1])
            made.data.materials.append(self.material(own, f"light {name}", radiance))
        elif ref is not None:
            made.data.materials.append(self.materials[ref.get("id")])
        else:
            made.data.materials.append(self.material(own, name))

    def flat(self, name, corners):
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata([(x, y, 0) for x, y in corners], [], [tuple(range(len(corners)))])
        layer = mesh.uv_layers.new()
        layer.data.foreach_set("uv", [c for x, y in corners for c in (0.5 * x + 0.5, 0.5 * y + 0.5)])
        made = bpy.data.objects.new(name, mesh)
        self.scene.collection.objects.link(made)
        return made

    def add_world(self):
        light = next((own for own in self.root.findall("emitter") if own.get("type") == "envmap"), None)
        world = self.scene.world = bpy.data.worlds.new("world")
        world.use_nodes = True
        nodes, links = world.node_tree.nodes, world.node_tree.links
        background = next(node for node in nodes if node.type == "BACKGROUND")
        background.inputs["Color"].default_value = (0, 0, 0, 1)
        if light is not None:
            node = nodes.new("ShaderNodeTexEnvironment")
            node.image = bpy.data.images.load(str((self.folder / value(light, "filename")).resolve()))
            links.new(node.outputs["Color"], background.inputs["Color"])
            background.inputs["Strength"].default_value = float(value(light, "scale", "1"))

    def add_camera(self):
        sensor = self.root.find("sensor")
        camera = bpy.data.cameras.new("camera")
        # Mitsuba looks along z with x to the left, Blender along -z with x to the right.
        camera.angle = math.radians(float(value(sensor, "fov")))
        made = bpy.data.objects.new("camera", camera)
        made.matrix_world = to_world(sensor) @ Matrix.Diagonal((-1, 1, -1, 1))
        self.scene.collection.objects.link(made)
        self.scene.camera = made


def prepare(options):
    """The settings of both renderers: paths of unlimited length, linear pixels, a box filter."""
    scene = bpy.context.scene
    width, height = (int(part) for part in options.resolution.split("x"))
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "IMAGE"
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGB", "32"
    scene.bdpm.use_error = False
    scene.bdpm.threads = 2
    scene.render.threads_mode, scene.render.threads = "FIXED", 2
    cycles = scene.cycles
    cycles.device, cycles.samples = "CPU", 1 << 20
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.sample_clamp_indirect = cycles.sample_clamp_direct = cycles.blur_glossy = cycles.light_sampling_threshold = 0
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = 32
    cycles.transparent_max_bounces = 32
    cycles.caustics_reflective = cycles.caustics_refractive = True


def render(engine, seconds, seed, path):
    from bdpm_render import exr

    scene = bpy.context.scene
    scene.render.engine, scene.render.filepath = engine, str(path)
    scene.bdpm.seed = scene.cycles.seed = seed
    scene.bdpm.use_time, scene.bdpm.time = True, seconds
    scene.cycles.time_limit = seconds
    start = time.monotonic()
    bpy.ops.render.render(write_still=True)
    print(f":: {engine} {path.name} took {time.monotonic() - start:.1f} s", flush=True)
    channels = exr.read(str(path))
    return np.stack([channels[letter] for letter in "RGB"], axis=-1).astype(np.float64)


def relative_error(image, reference):
    """The squared relative error of the luminance (theory.md (95)), without the worst pixels, and the ratio of means."""
    ours, truth = image @ LUMINANCE, reference @ LUMINANCE
    errors = (ours - truth) ** 2 / (truth**2 + 0.01 * truth.mean() ** 2)
    # The brightest thousandth has fireflies of either program.
    kept = np.sort(errors.reshape(-1))[: -max(1, errors.size // 1000)]
    return errors.mean(), kept.mean(), ours.mean() / truth.mean()


def compare(options, folder):
    import bdpm_render
    from bdpm_render import engine

    bdpm_render.register()
    program = os.environ.get("BDPM", str(ROOT / "target/release/bdpm"))
    engine.program_path = lambda: program
    prepare(options)
    images = {}
    for name in ("BDPM", "CYCLES"):
        images[name] = [render(name, options.compare, seed, folder / f"{name}-{seed}.exr") for seed in (1, 2)]
    references = {name: render(name, options.reference, 9, folder / f"{name}-9.exr") for name in images}
    print("| program | reference | mean squared error | without the worst .1 % | mean |\n|---|---|---|---|---|")
    for name, of_seeds in images.items():
        for other, reference in references.items():
            rows = np.mean([relative_error(image, reference) for image in of_seeds], axis=0)
            print("| {} | {} | {:.3g} | {:.3g} | {:.4f} |".format(name, other, *rows), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--compare", type=float)
    parser.add_argument("--reference", type=float, default=120)
    parser.add_argument("--resolution", default="320x180")
    parser.add_argument("--maps", action="store_true")
    parser.add_argument("rooms", nargs="+", type=pathlib.Path)
    options = parser.parse_args()
    for path in options.rooms:
        Room(path, options.maps)
        stem = path.with_name("room-maps" if options.maps else "room")
        bpy.ops.wm.save_as_mainfile(filepath=str(stem.with_suffix(".blend").resolve()))
        bpy.ops.export_scene.gltf(filepath=str(stem.with_suffix(".glb").resolve()), export_cameras=True, export_yup=True)
        if options.compare:
            compare(options, path.parent.resolve())


if __name__ == "__main__":
    main()
