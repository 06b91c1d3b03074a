"""Small scenes for blender_check.py: one for every light, camera and world; materials are in blender_materials.py."""

import math
import os
from dataclasses import dataclass

import bpy
import numpy as np

PHOTOMETRY = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "tests", "data", "photometry")

ALL = []
EXACT = 0.01
# Spots were brighter along their axis then, lamps of a size flat, and principled surfaces others.
IS_OLD = bpy.app.version < (4, 0)


@dataclass
class Element:
    """A scene, and how far the mean of a channel may be from that of Cycles."""

    name: str
    build: object
    tolerance: float = EXACT
    # Whether both show something else, so that scores mean nothing, and whether the add-on has to tell of it.
    is_approximate: bool = False
    is_reported: bool = True
    effort: float = 1.0


def element(name, tolerance=None, reported=True, effort=1.0, old=None):
    """Adds a scene: with a tolerance it is approximated; `old` is that for Blender 3."""
    tolerance = old if IS_OLD and old else tolerance

    def add(build):
        ALL.append(Element(name, build, tolerance or EXACT, tolerance is not None, reported, effort))
        return build

    return add


def material(name="surface", **inputs):
    """A principled material with these inputs, spaces as underscores; old and new names of inputs count alike."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"]
    for key, value in inputs.items():
        socket(shader, key).default_value = value
    return made


RENAMED = {
    "Transmission": "Transmission Weight",
    "Emission": "Emission Color",
    "Clearcoat": "Coat Weight",
    "Clearcoat_Roughness": "Coat Roughness",
    "Specular": "Specular IOR Level",
}


def socket(node, key):
    name = key.replace("_", " ")
    return node.inputs[name] if name in node.inputs else node.inputs[RENAMED[key]]


def shader(kind, name="surface", **inputs):
    """A material of one shader node."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    nodes.remove(nodes["Principled BSDF"])
    node = nodes.new(kind)
    for key, value in inputs.items():
        if key[0].islower():
            setattr(node, key, value)
        else:
            node.inputs[key.replace("_", " ")].default_value = value
    links.new(node.outputs[0], nodes["Material Output"].inputs["Surface"])
    return made, node


def chalk(value=0.5):
    color = value if isinstance(value, tuple) else (value,) * 3
    return shader("ShaderNodeBsdfDiffuse", "chalk", Color=(*color, 1))[0]


def floor(look=None, size=8):
    bpy.ops.mesh.primitive_plane_add(size=size)
    bpy.context.object.data.materials.append(look or chalk())
    return bpy.context.object


def ball(look=None, location=(0, 0, 1), radius=1.0):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, location=location, radius=radius)
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(look or chalk(0.7))
    return bpy.context.object


def camera(location=(0, -6, 3), rotation=(1.2, 0, 0), **data):
    bpy.ops.object.camera_add(location=location, rotation=rotation)
    bpy.context.scene.camera = bpy.context.object
    for key, value in data.items():
        setattr(bpy.context.object.data, key, value)
    return bpy.context.object


def light(kind, location=(1.5, -2, 4), rotation=(0.4, 0.3, 0), **data):
    bpy.ops.object.light_add(type=kind, location=location, rotation=rotation)
    for key, value in data.items():
        # Blender 3 has only the sharp falloff.
        if key != "use_soft_falloff" or not IS_OLD:
            setattr(bpy.context.object.data, key, value)
    return bpy.context.object


def world(color=(0.5, 0.6, 0.8), strength=1.0):
    made = bpy.data.worlds.new("world")
    made.use_nodes = True
    node = made.node_tree.nodes["Background"]
    node.inputs["Color"].default_value = (*color, 1)
    node.inputs["Strength"].default_value = strength
    bpy.context.scene.world = made
    return made


def stage(look=None):
    """A ball on a floor, seen from the side."""
    floor()
    ball(look)
    camera()


def picture(name="squares", size=16, is_data=False, alpha=None):
    """Squares of two colors, or of two numbers."""
    made = bpy.data.images.new(name, size, size, alpha=alpha is not None)
    if is_data:
        made.colorspace_settings.name = "Non-Color"
    pixels = np.ones((size, size, 4), np.float32)
    squares = (np.add.outer(np.arange(size), np.arange(size)) // 2 % 2).astype(bool)
    pixels[squares, :3] = (0.9, 0.4, 0.2)
    pixels[~squares, :3] = (0.2, 0.3, 0.7)
    pixels[: size // 4, :, :3] = (0.1, 0.6, 0.1)  # to tell up from down, and left from right
    pixels[:, : size // 8, :3] = 0.05
    if alpha is not None:
        pixels[squares, 3] = alpha
    made.pixels.foreach_set(pixels.reshape(-1))
    made.pack()
    return made


def textured(look, input_name="Base Color", uv=None, mapping=None, **image):
    """Puts a picture before an input; `mapping` are inputs of a mapping node."""
    nodes, links = look.node_tree.nodes, look.node_tree.links
    target = next(node for node in nodes if input_name in node.inputs)
    node = nodes.new("ShaderNodeTexImage")
    node.image, node.interpolation = picture(**image), "Closest"
    links.new(node.outputs["Color"], target.inputs[input_name])
    if mapping:
        map_node, coordinates = nodes.new("ShaderNodeMapping"), nodes.new("ShaderNodeTexCoord")
        for key, value in mapping.items():
            map_node.inputs[key].default_value = value
        links.new(coordinates.outputs["UV"], map_node.inputs["Vector"])
        links.new(map_node.outputs["Vector"], node.inputs["Vector"])
    return node


# Lights.


@element("light point")
def _(scene):
    stage()
    light("POINT", energy=300, shadow_soft_size=0, color=(1, 0.8, 0.5))


@element("light point size", tolerance=0.02, reported=False)
def _(scene):
    stage()
    light("POINT", energy=300, shadow_soft_size=0.4)


@element("light point size sharp", reported=False, old=0.02)
def _(scene):
    stage()
    lamp = light("POINT", energy=300, shadow_soft_size=0.4).data
    if hasattr(lamp, "use_soft_falloff"):
        lamp.use_soft_falloff = False


@element("light spot", old=0.05)
def _(scene):
    stage()
    light("SPOT", energy=500, shadow_soft_size=0, spot_size=0.7, spot_blend=0)


@element("light spot blend", old=0.05)
def _(scene):
    stage()
    light("SPOT", energy=500, shadow_soft_size=0, spot_size=0.9, spot_blend=0.8)


@element("light spot size", tolerance=0.02, old=0.05)
def _(scene):
    stage()
    light("SPOT", energy=500, shadow_soft_size=0.3, spot_size=0.9, spot_blend=0.5)


def ies(lamp, path, is_internal=False, strength=1.0):
    """Multiplies the strength of a light with an IES file, of a text datablock or of the disk."""
    data = lamp.data
    data.use_nodes = True
    nodes, links = data.node_tree.nodes, data.node_tree.links
    emission = next(node for node in nodes if node.type == "EMISSION")
    node, product = nodes.new("ShaderNodeTexIES"), nodes.new("ShaderNodeMath")
    product.operation, product.inputs[0].default_value = "MULTIPLY", 0.5
    node.inputs["Strength"].default_value = strength
    node.mode = "INTERNAL" if is_internal else "EXTERNAL"
    if is_internal:
        node.ies = bpy.data.texts.load(path)
    elif path:
        node.filepath = path
    links.new(node.outputs[0], product.inputs[1])
    links.new(product.outputs[0], emission.inputs["Strength"])
    return node


def luminaire(name, file, kind, turn, tolerance=None, is_internal=False, **data):
    @element(f"light ies {name}", tolerance, reported=False)
    def _(scene):
        stage()
        ies(light(kind, (0.8, -1.5, 2.7), turn, **data), os.path.join(PHOTOMETRY, file), is_internal)


# Type C, all of whose planes are mirrored from the first quarter; a text datablock, and a file.
luminaire("quarter", "quarter.ies", "POINT", (0.4, 0.3, 0.7), is_internal=True, shadow_soft_size=0, energy=1)
luminaire("tilted", "tilted.ies", "POINT", (1.2, -0.5, 2.0), shadow_soft_size=0, energy=50, color=(1, 0.6, 0.3))
luminaire("type B", "flood.ies", "POINT", (0.4, 0.3, 0.7), shadow_soft_size=0, energy=0.001)
luminaire("type A", "headlamp.ies", "POINT", (-1.0, 0.1, 0.3), shadow_soft_size=0, energy=10)
luminaire("size", "quarter.ies", "POINT", (0.4, 0.3, 0.7), 0.03, shadow_soft_size=0.3, energy=1)
luminaire("size sharp", "quarter.ies", "POINT", (0.4, 0.3, 0.7), shadow_soft_size=0.3, energy=1, use_soft_falloff=False)
luminaire("spot", "quarter.ies", "SPOT", (0.4, 0.3, 0.7), shadow_soft_size=0, energy=1, spot_size=0.9, spot_blend=0.6)
luminaire("spot sharp", "tilted.ies", "SPOT", (0.4, 0.3, 0), shadow_soft_size=0, energy=50, spot_size=0.9, spot_blend=0)
luminaire("area", "quarter.ies", "AREA", (0.4, 0.3, 0.7), energy=1, shape="RECTANGLE", size=1.0, size_y=0.5)
luminaire("area disk", "tilted.ies", "AREA", (0.4, 0.3, 0.7), energy=50, shape="DISK", size=1.0)
luminaire("sun", "quarter.ies", "SUN", (0.4, 0.3, 0.7), energy=0.003, angle=0)


@element("light ies squeezed")
def _(scene):
    stage()
    lamp = light("POINT", (0.8, -1.5, 2.7), (0.4, 0.3, 0.7), shadow_soft_size=0, energy=1)
    lamp.scale = (1, 1.5, 0.8)
    ies(lamp, os.path.join(PHOTOMETRY, "quarter.ies"))


@element("light ies missing", tolerance=EXACT)
def _(scene):
    stage()
    ies(light("POINT", energy=8, shadow_soft_size=0), os.path.join(PHOTOMETRY, "absent.ies"))


@element("light sun")
def _(scene):
    stage()
    light("SUN", energy=3, angle=0, color=(1, 0.9, 0.8))


@element("light sun half a degree", tolerance=EXACT)
def _(scene):
    stage()
    light("SUN", energy=3, angle=math.radians(0.526))


@element("light sun wide", tolerance=EXACT)
def _(scene):
    stage()
    light("SUN", energy=3, angle=math.radians(20))


for shape in ("SQUARE", "RECTANGLE", "DISK", "ELLIPSE"):

    @element(f"light area {shape.lower()}")
    def _(scene, shape=shape):
        stage()
        light("AREA", energy=150, shape=shape, size=1.5, size_y=0.5)


@element("light area scaled")
def _(scene):
    stage()
    light("AREA", energy=150, shape="RECTANGLE", size=1.0, size_y=0.5).scale = (2, 1.5, 1)


@element("light area seen")
def _(scene):
    stage()
    light("AREA", (0, 2, 2), (1.2, 0, 0), energy=150, size=1.0).visible_camera = True


@element("light area hidden")
def _(scene):
    stage()
    light("AREA", (0, 2, 2), (-1.8, 0, 0), energy=150, size=1.0)


@element("light mesh")
def _(scene):
    stage()
    bpy.ops.mesh.primitive_plane_add(size=1, location=(1.2, -0.5, 2), rotation=(0.3, 0.5, 0))
    bpy.context.object.data.materials.append(
        shader("ShaderNodeEmission", "glow", Color=(1, 0.7, 0.4, 1), Strength=15)[0]
    )


@element("light mesh closed")
def _(scene):
    stage()
    ball(shader("ShaderNodeEmission", "glow", Color=(1, 0.7, 0.4, 1), Strength=15)[0], (1.5, -1, 2), 0.4)


# Cameras.


@element("camera shift")
def _(scene):
    floor()
    ball()
    camera(shift_x=0.15, shift_y=-0.1)
    light("POINT", energy=300, shadow_soft_size=0.2)


@element("camera fit vertical")
def _(scene):
    floor()
    ball()
    camera(sensor_fit="VERTICAL", lens=30, shift_x=0.1)
    scene.render.resolution_x = 96
    light("POINT", energy=300, shadow_soft_size=0.2)


@element("camera region")
def _(scene):
    floor()
    ball()
    camera(shift_x=0.1)
    render = scene.render
    render.use_border = render.use_crop_to_border = True
    render.resolution_x, render.resolution_y = 128, 96
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 1 / 6, 5 / 6
    light("POINT", energy=300, shadow_soft_size=0.2)


@element("camera depth of field")
def _(scene):
    floor()
    ball(location=(-1.2, 1, 1))
    ball(chalk((0.8, 0.3, 0.2)), location=(1, -2, 0.6), radius=0.6)
    dof = camera(lens=60).data.dof
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, 4.5, 0.1
    light("POINT", energy=300, shadow_soft_size=0.2)


@element("camera orthographic")
def _(scene):
    floor()
    ball()
    camera(type="ORTHO", ortho_scale=5, shift_x=0.1, shift_y=-0.05)
    light("POINT", energy=300, shadow_soft_size=0.2)


@element("camera orthographic region")
def _(scene):
    floor()
    ball()
    camera(type="ORTHO", ortho_scale=6, sensor_fit="VERTICAL")
    render = scene.render
    render.use_border = render.use_crop_to_border = True
    render.resolution_x, render.resolution_y = 128, 96
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 1 / 6, 5 / 6
    light("POINT", energy=300, shadow_soft_size=0.2)


# Worlds.


@element("world color")
def _(scene):
    stage()
    world(strength=0.7)


def sky(rotation):
    made = world(strength=1.5)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    image = bpy.data.images.new("sky", 64, 32, float_buffer=True)
    pixels = np.full((32, 64, 4), 0.1, np.float32)
    pixels[16:, :, 2] = 0.6
    pixels[22:27, 8:16, :3] = (9, 6, 2)
    pixels[14:20, 40:50, :3] = (0.5, 3, 1)
    image.pixels.foreach_set(pixels.reshape(-1))
    image.pack()
    texture, mapping, coordinates = (
        nodes.new(f"ShaderNode{kind}") for kind in ("TexEnvironment", "Mapping", "TexCoord")
    )
    texture.image, texture.interpolation = image, "Closest"
    mapping.inputs["Rotation"].default_value = rotation
    links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], nodes["Background"].inputs["Color"])


@element("world texture")
def _(scene):
    stage()
    sky((0, 0, 0))


@element("world texture turned")
def _(scene):
    stage()
    sky((0, 0, 2.1))


@element("world texture tilted", tolerance=0.02, reported=False)
def _(scene):
    stage()
    sky((0.7, 0.3, 2.1))


@element("world of other nodes", tolerance=EXACT)
def _(scene):
    stage()
    made = world(strength=0.8)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    gradient, coordinates = nodes.new("ShaderNodeTexGradient"), nodes.new("ShaderNodeTexCoord")
    links.new(coordinates.outputs["Generated"], gradient.inputs["Vector"])
    links.new(gradient.outputs["Color"], nodes["Background"].inputs["Color"])


@element("world sky", tolerance=0.03)
def _(scene):
    stage()
    made = world(strength=0.3)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    sky_node = nodes.new("ShaderNodeTexSky")
    sky_node.sun_elevation, sky_node.sun_rotation = 0.6, 2.0
    links.new(sky_node.outputs["Color"], nodes["Background"].inputs["Color"])
