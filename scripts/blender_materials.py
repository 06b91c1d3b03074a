"""Small scenes for blender_check.py: one for every material, and for kinds of geometry."""

import bpy
import numpy as np
from blender_elements import ball, camera, chalk, element, floor, light, material, shader, sky, stage, textured, world

# Materials, under a sky with bright places, in which all is seen. Lamps would be in its way: here, but not in Cycles.


def lit(look):
    stage(look)
    sky((0, 0, 0.6))


@element("light blocks the world", tolerance=0.03, reported=False)
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
surface(
    "coat", 0.06, Base_Color=(0.6, 0.1, 0.05, 1), Roughness=0.9, Specular=0.0, Clearcoat=1.0, Clearcoat_Roughness=0.0
)


def single(name, kind, tolerance=None, effort=1.0, reported=False, **inputs):
    element(f"material {name}", tolerance, reported, effort)(lambda scene: lit(shader(kind, **inputs)[0]))


single("diffuse", "ShaderNodeBsdfDiffuse", Color=(0.7, 0.3, 0.1, 1))
single("glossy", "ShaderNodeBsdfGlossy", Color=(0.7, 0.5, 0.3, 1), Roughness=0.2, distribution="GGX")
single("glossy smooth", "ShaderNodeBsdfGlossy", Color=(0.7, 0.5, 0.3, 1), Roughness=0.0)
single(
    "glossy multiple", "ShaderNodeBsdfGlossy", 0.02, Color=(0.7, 0.5, 0.3, 1), Roughness=0.5, distribution="MULTI_GGX"
)
single("glass shader", "ShaderNodeBsdfGlass", Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.45)
single("glass shader rough", "ShaderNodeBsdfGlass", Color=(1, 1, 1, 1), Roughness=0.3, IOR=1.45, distribution="GGX")


@element("material glass abbe", 0.02, False)
def _(scene):
    """Cycles has no dispersion, which moves colors and the means of the channels by one percent."""
    look = shader("ShaderNodeBsdfGlass", Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.5)[0]
    look["abbe"] = 20.0
    lit(look)


GREEN = (0.6, 0.9, 0.7, 1)
single("glass shader tinted", "ShaderNodeBsdfGlass", 0.03, reported=True, Color=GREEN, Roughness=0.0, IOR=1.45)
single("refraction", "ShaderNodeBsdfRefraction", 0.05, reported=True, Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.45)
single("transparent", "ShaderNodeBsdfTransparent", Color=(0.6, 0.8, 0.9, 1))
single("translucent", "ShaderNodeBsdfTranslucent", Color=(0.8, 0.8, 0.8, 1))


def volume(name, surface_kind, tolerance, *nodes, **inputs):
    """A ball with a volume, and a surface of this kind or none."""

    @element(f"material {name}", tolerance, False)
    def _(scene):
        if surface_kind:
            look = shader(surface_kind, **inputs)[0]
            tree = look.node_tree
        else:
            look = bpy.data.materials.new("volume")
            look.use_nodes = True
            tree = look.node_tree
            tree.nodes.clear()
            tree.nodes.new("ShaderNodeOutputMaterial")
        output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
        made = []
        for kind, values in nodes:
            node = tree.nodes.new(kind)
            for key, value in values.items():
                node.inputs[key].default_value = value
            made.append(node)
        last = made[0]
        if len(made) == 2:
            last = tree.nodes.new("ShaderNodeAddShader")
            for number, node in enumerate(made):
                tree.links.new(node.outputs[0], last.inputs[number])
        tree.links.new(last.outputs[0], output.inputs["Volume"])
        lit(look)


INK = ("ShaderNodeVolumeAbsorption", {"Color": (0.8, 0.4, 0.1, 1), "Density": 1.5})
MILK = ("ShaderNodeVolumeScatter", {"Color": (0.9, 0.8, 0.6, 1), "Density": 3.0, "Anisotropy": 0.4})
volume("volume absorption in glass", "ShaderNodeBsdfGlass", None, INK, Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.33)
volume("volume scatter", None, 0.02, MILK)
volume("volume sum", None, 0.02, INK, MILK)
PRINCIPLED = {"Color": (0.7, 0.5, 0.3, 1), "Density": 2.0, "Anisotropy": 0.0, "Absorption Color": (0.1, 0.2, 0.4, 1)}
volume("volume principled", None, 0.02, ("ShaderNodeVolumePrincipled", PRINCIPLED))


def mixed(name, first, second, tolerance=None, reported=False, kind="ShaderNodeMixShader", share=0.3):
    @element(f"material {name}", tolerance, reported)
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
mixed("mix translucent", RED, ("ShaderNodeBsdfTranslucent", {"Color": (0.1, 0.6, 0.2, 1)}), share=0.6)
mixed("mix transparent", RED, ("ShaderNodeBsdfTransparent", {}))
mixed("mix emission", RED, ("ShaderNodeEmission", {"Strength": 2.0}))
mixed("mix glossy", RED, ("ShaderNodeBsdfGlossy", {"Roughness": 0.3}), 0.03, True)
mixed("add emission", RED, ("ShaderNodeEmission", {"Strength": 0.5}), kind="ShaderNodeAddShader")


def textured_floor(name, **options):
    """A floor whose color is a picture."""

    @element(name)
    def _(scene):
        look = chalk()
        textured(look, "Color", **options)
        floor(look)
        ball()
        camera()
        light("POINT", energy=300, shadow_soft_size=0.2)


textured_floor("material texture")
textured_floor(
    "material texture mapped",
    mapping={"Scale": (3, 2, 1), "Rotation": (0, 0, 0.5), "Location": (0.2, 0.1, 0)},
)


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
