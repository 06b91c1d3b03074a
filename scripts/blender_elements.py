"""Small scenes for blender_check.py: one for every light, camera, world and material."""

import math
from dataclasses import dataclass

import bpy
import numpy as np

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
    is_told: bool = True
    effort: float = 1.0


def element(name, tolerance=None, told=True, effort=1.0, old=None):
    """Adds a scene: with a tolerance it is approximated; `old` is that for Blender 3."""
    tolerance = old if IS_OLD and old else tolerance

    def add(build):
        ALL.append(Element(name, build, tolerance or EXACT, tolerance is not None, told, effort))
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


@element("light point size", tolerance=0.02, told=False)
def _(scene):
    stage()
    light("POINT", energy=300, shadow_soft_size=0.4)


@element("light point size sharp", told=False, old=0.02)
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
    bpy.context.object.data.materials.append(shader("ShaderNodeEmission", "glow", Color=(1, 0.7, 0.4, 1), Strength=15)[0])


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


@element("world texture tilted", tolerance=0.02, told=False)
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


# Materials, under a sky with bright places, in which all is seen. Lamps would be in its way: here, but not in Cycles.


def lit(look):
    stage(look)
    sky((0, 0, 0.6))


@element("light blocks the world", tolerance=0.03, told=False)
def _(scene):
    stage()
    light("AREA", (2, -2, 4), (0.5, 0.5, 0), energy=250, size=2)
    world((0.3, 0.35, 0.4), 1.0)


def surface(name, tolerance=None, effort=1.0, **inputs):
    old = max(tolerance or 0, 0.03)
    element(f"material {name}", tolerance, False, effort, old)(lambda scene: lit(material(**inputs)))


surface("plastic", None, Base_Color=(0.6, 0.1, 0.05, 1), Roughness=0.3)
surface("plastic rough", None, Base_Color=(0.6, 0.5, 0.4, 1), Roughness=0.8)
surface("metal", None, Base_Color=(0.9, 0.6, 0.2, 1), Metallic=1.0, Roughness=0.2)
surface("metal rough", None, Base_Color=(0.9, 0.6, 0.2, 1), Metallic=1.0, Roughness=0.6)
surface("metal half", None, Base_Color=(0.7, 0.5, 0.3, 1), Metallic=0.5, Roughness=0.4)
surface("glass", None, Base_Color=(1, 1, 1, 1), Transmission=1.0, Roughness=0.0, IOR=1.5)
surface("glass tinted", None, Base_Color=(0.5, 0.8, 0.9, 1), Transmission=1.0, Roughness=0.0, IOR=1.33)
surface("glass rough", 0.03, Base_Color=(1, 1, 1, 1), Transmission=1.0, Roughness=0.3, IOR=1.5)
surface("emission", None, Base_Color=(0.5, 0.5, 0.5, 1), Emission=(1, 0.4, 0.2, 1), Emission_Strength=0.8)
surface("alpha", None, Base_Color=(0.8, 0.2, 0.2, 1), Alpha=0.4)
surface("coat", 0.06, Base_Color=(0.6, 0.1, 0.05, 1), Roughness=0.9, Specular=0.0, Clearcoat=1.0, Clearcoat_Roughness=0.0)


def single(name, kind, tolerance=None, effort=1.0, told=False, **inputs):
    element(f"material {name}", tolerance, told, effort)(lambda scene: lit(shader(kind, **inputs)[0]))


single("diffuse", "ShaderNodeBsdfDiffuse", Color=(0.7, 0.3, 0.1, 1))
single("glossy", "ShaderNodeBsdfGlossy", Color=(0.7, 0.5, 0.3, 1), Roughness=0.2, distribution="GGX")
single("glossy smooth", "ShaderNodeBsdfGlossy", Color=(0.7, 0.5, 0.3, 1), Roughness=0.0)
single("glossy multiple", "ShaderNodeBsdfGlossy", 0.02, Color=(0.7, 0.5, 0.3, 1), Roughness=0.5, distribution="MULTI_GGX")
single("glass shader", "ShaderNodeBsdfGlass", Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.45)
single("glass shader rough", "ShaderNodeBsdfGlass", Color=(1, 1, 1, 1), Roughness=0.3, IOR=1.45, distribution="GGX")
single("glass shader tinted", "ShaderNodeBsdfGlass", 0.03, told=True, Color=(0.6, 0.9, 0.7, 1), Roughness=0.0, IOR=1.45)
single("refraction", "ShaderNodeBsdfRefraction", 0.05, told=True, Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.45)
single("transparent", "ShaderNodeBsdfTransparent", Color=(0.6, 0.8, 0.9, 1))
single("translucent", "ShaderNodeBsdfTranslucent", 0.2, told=True, Color=(0.8, 0.8, 0.8, 1))


def mixed(name, first, second, tolerance=None, told=False, kind="ShaderNodeMixShader", share=0.3):
    @element(f"material {name}", tolerance, told)
    def _(scene):
        look, node = shader(first[0], **first[1])
        nodes, links = look.node_tree.nodes, look.node_tree.links
        other = nodes.new(second[0])
        for key, value in second[1].items():
            other.inputs[key].default_value = value
        mix = nodes.new(kind)
        at = 1 if kind == "ShaderNodeMixShader" else 0
        if at:
            mix.inputs[0].default_value = share
        links.new(node.outputs[0], mix.inputs[at])
        links.new(other.outputs[0], mix.inputs[at + 1])
        links.new(mix.outputs[0], nodes["Material Output"].inputs["Surface"])
        lit(look)


RED = ("ShaderNodeBsdfDiffuse", {"Color": (0.8, 0.2, 0.1, 1)})
mixed("mix diffuse", RED, ("ShaderNodeBsdfDiffuse", {"Color": (0.1, 0.3, 0.9, 1)}))
mixed("mix transparent", RED, ("ShaderNodeBsdfTransparent", {}))
mixed("mix emission", RED, ("ShaderNodeEmission", {"Strength": 2.0}))
mixed("mix glossy", RED, ("ShaderNodeBsdfGlossy", {"Roughness": 0.3}), 0.03, True)
mixed("add emission", RED, ("ShaderNodeEmission", {"Strength": 0.5}), kind="ShaderNodeAddShader")


@element("material texture")
def _(scene):
    look = chalk()
    textured(look, "Color")
    floor(look)
    ball()
    camera()
    light("POINT", energy=300, shadow_soft_size=0.2)


@element("material texture mapped")
def _(scene):
    look = chalk()
    textured(look, "Color", mapping={"Scale": (3, 2, 1), "Rotation": (0, 0, 0.5), "Location": (0.2, 0.1, 0)})
    floor(look)
    ball()
    camera()
    light("POINT", energy=300, shadow_soft_size=0.2)


@element("material texture math")
def _(scene):
    look = chalk()
    node = textured(look, "Color")
    nodes, links = look.node_tree.nodes, look.node_tree.links
    invert, gamma = nodes.new("ShaderNodeInvert"), nodes.new("ShaderNodeGamma")
    gamma.inputs["Gamma"].default_value = 1.5
    links.new(node.outputs["Color"], invert.inputs["Color"])
    links.new(invert.outputs["Color"], gamma.inputs["Color"])
    links.new(gamma.outputs["Color"], nodes["Diffuse BSDF"].inputs["Color"])
    floor(look)
    ball()
    camera()
    light("POINT", energy=300, shadow_soft_size=0.2)


@element("material color attribute")
def _(scene):
    look = chalk()
    nodes, links = look.node_tree.nodes, look.node_tree.links
    node = nodes.new("ShaderNodeVertexColor")
    node.layer_name = "paint"
    links.new(node.outputs["Color"], nodes["Diffuse BSDF"].inputs["Color"])
    floor()
    mesh = ball(look).data
    attribute = mesh.color_attributes.new("paint", "FLOAT_COLOR", "POINT")
    positions = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", positions)
    colors = np.ones((len(mesh.vertices), 4), np.float32)
    colors[:, :3] = np.clip(0.5 + 0.5 * positions.reshape(-1, 3), 0, 0.9)
    attribute.data.foreach_set("color", colors.reshape(-1))
    camera()
    light("POINT", energy=300, shadow_soft_size=0.2)


@element("material texture alpha")
def _(scene):
    look = material(Base_Color=(0.8, 0.3, 0.2, 1), Roughness=1.0, Specular=0.0)
    node = textured(look, alpha=0.0)
    look.node_tree.links.remove(node.outputs["Color"].links[0])
    look.node_tree.links.new(node.outputs["Alpha"], look.node_tree.nodes["Principled BSDF"].inputs["Alpha"])
    floor()
    bpy.ops.mesh.primitive_plane_add(size=2, location=(0, 0, 1), rotation=(1.0, 0, 0))
    bpy.context.object.data.materials.append(look)
    camera()
    light("POINT", energy=300, shadow_soft_size=0.2)


# Geometry.


@element("geometry of all kinds")
def _(scene):
    floor()
    bpy.ops.mesh.primitive_cube_add(size=1, location=(-1.5, 0, 0.6))
    bpy.context.object.modifiers.new("round", "SUBSURF").render_levels = 2
    bpy.ops.object.text_add(location=(0.2, -1.5, 0.1), rotation=(1.2, 0, 0))
    bpy.context.object.data.extrude = 0.1
    bpy.ops.curve.primitive_bezier_circle_add(location=(1.5, 0, 0.8), radius=0.6)
    bpy.context.object.data.bevel_depth = 0.2
    for one in scene.objects:
        if one.type != "MESH":
            one.data.materials.append(chalk((0.2, 0.5, 0.8)))
    bpy.ops.mesh.primitive_monkey_add(location=(0, 1, 0.9))
    monkey = bpy.context.object
    monkey.data.materials.append(chalk((0.8, 0.3, 0.2)))
    monkey.data.materials.append(chalk((0.2, 0.8, 0.3)))
    for polygon in monkey.data.polygons:
        polygon.material_index = polygon.index % 2
    camera()
    light("POINT", energy=300, shadow_soft_size=0.2)


@element("geometry instances")
def _(scene):
    floor()
    kit = bpy.data.collections.new("kit")
    bpy.ops.mesh.primitive_monkey_add(location=(0, 0, 0.5), size=0.8)
    monkey = bpy.context.object
    monkey.data.materials.append(chalk((0.8, 0.3, 0.2)))
    scene.collection.objects.unlink(monkey) if monkey.name in scene.collection.objects else None
    for collection in list(monkey.users_collection):
        collection.objects.unlink(monkey)
    kit.objects.link(monkey)
    for k in range(12):
        place = bpy.data.objects.new(f"place {k}", None)
        place.instance_type, place.instance_collection = "COLLECTION", kit
        place.location = (-2 + k % 4 * 1.3, -1 + k // 4 * 1.4, 0)
        place.rotation_euler = (0, 0, 0.7 * k)
        place.scale = (0.6 + 0.05 * k, -0.8 if k % 3 == 1 else 0.8, 0.8)
        scene.collection.objects.link(place)
    camera()
    light("POINT", energy=300, shadow_soft_size=0.2)
