#!/usr/bin/env python3
"""Rooms by Cycles with path guiding by Intel's Open Path Guiding Library and without, as rows of a table.

usage: cycles_guiding.py [--width W] [--samples N,...] ROOM.xml...

Wants Blender as a Python module (`pip install bpy==5.0.1 numpy`). ROOM.xml is a scene that interior_scenes.py wrote.
It is rebuilt in Blender: geometry, textures and lights of the file, plastics as Principled, metals without their colors.
Cycles renders it on two threads without and with guiding of surfaces, twice each. The default of 128 samples of
training is part of the image. The squared error of an image is half of the squared difference between both, relative
as in interiors.py. The rows are ratios of guided over unguided images: squared error, squared error without the worst
.1 % of the pixels, seconds, and the product of the first and the last.
"""

import argparse
import math
import pathlib
import tempfile
import time
import xml.etree.ElementTree as tree

import bpy
import mathutils
import numpy as np


def child(element, name):
    return next((one for one in element if one.get("name") == name), None)


def numbers(text):
    return [float(number) for number in text.replace(",", " ").split()]


def matrix(element):
    transform = next((one for one in element if one.tag == "transform"), None)
    if transform is None:
        return mathutils.Matrix.Identity(4)
    values = numbers(transform.find("matrix").get("value"))
    return mathutils.Matrix([values[row * 4 : row * 4 + 4] for row in range(4)])


def empty_material(kind):
    """A material of one shader, which is returned with it."""
    material = bpy.data.materials.new(kind)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    output, shader = nodes.new("ShaderNodeOutputMaterial"), nodes.new(kind)
    material.node_tree.links.new(shader.outputs[0], output.inputs[0])
    return material, shader


def set_color(folder, material, socket, value):
    if value is None:
        return
    if value.tag == "rgb":
        socket.default_value = (*numbers(value.get("value")), 1)
        return
    texture = material.node_tree.nodes.new("ShaderNodeTexImage")
    file = folder / child(value, "filename").get("value")
    texture.image = bpy.data.images.load(str(file), check_existing=True)
    material.node_tree.links.new(texture.outputs[0], socket)


def material_of(folder, bsdf):
    while bsdf.get("type") in ("twosided", "mask"):
        bsdf = bsdf.find("bsdf")
    kind, alpha = bsdf.get("type"), child(bsdf, "alpha")
    roughness = math.sqrt(float(alpha.get("value"))) if alpha is not None else 0.0
    if kind == "diffuse":
        material, shader = empty_material("ShaderNodeBsdfDiffuse")
        set_color(folder, material, shader.inputs[0], child(bsdf, "reflectance"))
    elif "dielectric" in kind:
        material, shader = empty_material("ShaderNodeBsdfGlass")
        shader.inputs["Roughness"].default_value = roughness
        shader.inputs["IOR"].default_value = 1.0 if kind == "thindielectric" else 1.5
    elif "conductor" in kind:
        material, shader = empty_material("ShaderNodeBsdfAnisotropic")
        shader.inputs["Roughness"].default_value = roughness
        shader.inputs["Color"].default_value = (0.8, 0.8, 0.8, 1)
    else:
        material, shader = empty_material("ShaderNodeBsdfPrincipled")
        shader.inputs["Roughness"].default_value = roughness
        set_color(folder, material, shader.inputs["Base Color"], child(bsdf, "diffuseReflectance"))
    return material


def emission(radiance):
    material, shader = empty_material("ShaderNodeEmission")
    shader.inputs["Color"].default_value = (1, 1, 1, 1)
    shader.inputs["Strength"].default_value = radiance
    return material


def objects_of(folder, shape):
    """The objects of a shape in its own coordinates."""
    if shape.get("type") == "obj":
        before = set(bpy.data.objects)
        file = str(folder / child(shape, "filename").get("value"))
        bpy.ops.wm.obj_import(filepath=file, forward_axis="Y", up_axis="Z", validate_meshes=True)
        return [one for one in bpy.data.objects if one not in before]
    mesh = bpy.data.meshes.new("rectangle")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    one = bpy.data.objects.new("rectangle", mesh)
    bpy.context.scene.collection.objects.link(one)
    return [one]


def build(room, width):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    root, folder, scene = tree.parse(room).getroot(), room.parent, bpy.context.scene
    materials = {bsdf.get("id"): material_of(folder, bsdf) for bsdf in root.findall("bsdf")}
    for shape in root.findall("shape"):
        lamp, reference = shape.find("emitter"), shape.find("ref")
        if lamp is not None:
            material = emission(numbers(lamp.find("rgb").get("value"))[0])
        elif reference is not None:
            material = materials[reference.get("id")]
        else:
            material = material_of(folder, shape.find("bsdf"))
        for one in objects_of(folder, shape):
            one.matrix_world = matrix(shape) @ one.matrix_world
            one.data.materials.clear()
            one.data.materials.append(material)
    for lamp in root.findall("emitter"):
        if lamp.get("type") == "envmap":
            add_environment(folder / child(lamp, "filename").get("value"))
    add_camera(root.find("sensor"), width)
    cycles, render = scene.cycles, scene.render
    render.engine, render.threads_mode, render.threads = "CYCLES", "FIXED", 2
    render.use_persistent_data = True
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    cycles.device, cycles.use_adaptive_sampling, cycles.use_denoising = "CPU", False, False
    cycles.sample_clamp_indirect = cycles.blur_glossy = 0
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = 64
    cycles.caustics_reflective = cycles.caustics_refractive = cycles.use_light_tree = True
    cycles.filter_width = 0.01
    cycles.use_surface_guiding, cycles.use_volume_guiding = True, False


def add_environment(file):
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world, world.use_nodes = world, True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    texture, mapping, place = (nodes.new(f"ShaderNode{name}") for name in ("TexEnvironment", "Mapping", "TexCoord"))
    texture.image = bpy.data.images.load(str(file))
    # The y axis of the room points up.
    mapping.inputs["Rotation"].default_value = (math.pi / 2, 0, 0)
    links.new(place.outputs["Generated"], mapping.inputs[0])
    links.new(mapping.outputs[0], texture.inputs[0])
    links.new(texture.outputs[0], nodes["Background"].inputs[0])


def add_camera(sensor, width):
    scene, camera = bpy.context.scene, bpy.data.cameras.new("camera")
    scene.camera = bpy.data.objects.new("camera", camera)
    scene.collection.objects.link(scene.camera)
    # Cameras of Mitsuba look along z with x to the left, those of Blender along -z.
    scene.camera.matrix_world = matrix(sensor) @ mathutils.Matrix.Diagonal((-1, 1, -1, 1))
    camera.sensor_fit, camera.clip_start = "HORIZONTAL", 0.01
    camera.angle = math.radians(float(child(sensor, "fov").get("value")))
    film = sensor.find("film")
    across, down = (int(child(film, name).get("value")) for name in ("width", "height"))
    scene.render.resolution_x, scene.render.resolution_y = width, round(width * down / across)
    scene.render.resolution_percentage = 100


def render(samples, guided, seed):
    """The luminance of each pixel, and the seconds that it took."""
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.use_guiding, scene.cycles.seed = samples, guided, seed
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(pathlib.Path(folder) / "image.exr")
        start = time.perf_counter()
        bpy.ops.render.render(write_still=True)
        seconds = time.perf_counter() - start
        image = bpy.data.images.load(scene.render.filepath)
        pixels = np.empty(len(image.pixels), dtype=np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
    return pixels.reshape(-1, 4)[:, :3].astype(float) @ np.array([0.2126, 0.7152, 0.0722]), seconds


def compare(room, samples):
    render(1, False, 0)  # builds the scene
    runs = {guided: [] for guided in (False, True)}
    for seed in (1, 2):
        for guided, results in runs.items():
            results.append(render(samples, guided, seed))
    mean = np.mean([image for results in runs.values() for image, _ in results], axis=0)
    scale = mean**2 + 0.01 * mean.mean() ** 2

    def measured(results):
        (one, first), (other, second) = results
        errors = np.sort((one - other) ** 2 / 2 / scale)
        return np.array([errors.mean(), errors[: int(0.999 * errors.size)].mean(), first + second])

    error, without_tails, seconds = measured(runs[True]) / measured(runs[False])
    print(f"| {room} | {samples} | {error:.2f} | {without_tails:.2f} | {seconds:.2f} | {error * seconds:.2f} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--width", type=int, default=160)
    parser.add_argument("--samples", type=lambda text: [int(n) for n in text.split(",")], default=[64, 256])
    parser.add_argument("rooms", nargs="+", type=pathlib.Path)
    options = parser.parse_args()
    for room in options.rooms:
        build(room, options.width)
        for samples in options.samples:
            compare(room.parent.name, samples)


if __name__ == "__main__":
    main()
