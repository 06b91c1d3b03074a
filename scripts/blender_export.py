"""Run by Blender, for blender-export.sh: exports the scene as glTF and renders it with Cycles."""

import sys

import bpy

RESOLUTION = (256, 192)


def material(name, **inputs):
    """A material of the principled shader with these inputs."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"]
    for key, value in inputs.items():
        shader.inputs[key.replace("_", " ")].default_value = value
    return made, shader


def ball(name, x, look):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24, location=(x, 0, 0.5), radius=0.5)
    bpy.ops.object.shade_smooth()
    made = bpy.context.object
    made.name = name
    made.data.materials.append(look)


def checkers():
    """A picture of 8 by 8 squares, one texel each."""
    picture = bpy.data.images.new("checkers", 8, 8)
    for y in range(8):
        for x in range(8):
            color = (0.8, 0.75, 0.6, 1) if (x + y) % 2 else (0.1, 0.2, 0.4, 1)
            start = 4 * (8 * y + x)
            picture.pixels[start : start + 4] = color
    picture.pack()
    return picture


def make_scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    floor, shader = material("floor", Roughness=0.4)
    nodes, links = floor.node_tree.nodes, floor.node_tree.links
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = checkers()
    texture.interpolation = "Closest"
    links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    bpy.ops.mesh.primitive_plane_add(size=8)
    bpy.context.object.data.materials.append(floor)

    plastic, _ = material("plastic", Base_Color=(0.6, 0.05, 0.04, 1), Roughness=0.3)
    gold, _ = material("gold", Base_Color=(0.9, 0.6, 0.2, 1), Metallic=1.0, Roughness=0.2)
    chalk, _ = material("chalk", Base_Color=(0.7, 0.7, 0.7, 1), Roughness=1.0)
    for x, look in ((-1.2, plastic), (0, gold), (1.2, chalk)):
        ball(look.name, x, look)

    glow, _ = material("glow", Base_Color=(0, 0, 0, 1), Emission=(1, 0.9, 0.7, 1), Emission_Strength=6.0)
    bpy.ops.mesh.primitive_plane_add(size=1.5, location=(-2, 1, 3), rotation=(3.14159, 0.5, 0))
    bpy.context.object.data.materials.append(glow)

    bpy.ops.object.light_add(type="POINT", location=(2, -2, 3))
    lamp = bpy.context.object.data
    lamp.energy = 150
    lamp.shadow_soft_size = 0

    bpy.ops.object.camera_add(location=(0, -5, 1.8), rotation=(1.33, 0, 0))
    scene = bpy.context.scene
    scene.camera = bpy.context.object
    scene.render.resolution_x, scene.render.resolution_y = RESOLUTION


def export(path):
    options = dict(filepath=path, export_format="GLB", export_cameras=True, export_lights=True)
    options.update(export_tangents=True, export_apply=True)
    known = bpy.ops.export_scene.gltf.get_rna_type().properties.keys()
    # Old versions have no choice of the unit of lights.
    if "export_import_convert_lighting_mode" in known:
        options["export_import_convert_lighting_mode"] = "SPEC"
    bpy.ops.export_scene.gltf(**options)


def render(path):
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 256
    scene.cycles.use_denoising = False
    scene.cycles.sample_clamp_indirect = 0
    scene.render.filepath = path
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    bpy.ops.render.render(write_still=True)


out, *given = sys.argv[sys.argv.index("--") + 1 :]
if not given:
    make_scene()
bpy.ops.preferences.addon_enable(module="io_scene_gltf2")
export(out + ".glb")
if not given:
    bpy.ops.preferences.addon_enable(module="cycles")
    render(out + "-cycles.exr")
