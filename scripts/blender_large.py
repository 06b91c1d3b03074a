"""Measures the time from F12 to the first picture of large scenes: 10^6 triangles with texture coordinates and normals,
and 10^5 instances, each rendered, then rendered again with the camera moved. Run it in Blender, or with Python and bpy:

    blender --background --python scripts/blender_large.py
"""

import os
import resource
import sys
import time

import bpy
import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
sys.path[:0] = [os.path.join(ROOT, "blender"), os.path.join(ROOT, "scripts")]

import bdpm_render  # noqa: E402
import blender_elements as elements  # noqa: E402
from bdpm_render import engine  # noqa: E402

SIDE = 708  # squares across and down: 10^6 triangles
PLACES = 100_000


def million():
    """Hills of a million triangles with a picture on them."""
    look = elements.chalk()
    elements.textured(look, "Color")
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=SIDE, y_subdivisions=SIDE, size=8, calc_uvs=True)
    mesh = bpy.context.object.data
    positions = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", positions)
    grid = positions.reshape(-1, 3)
    grid[:, 2] = 0.3 * np.sin(2 * grid[:, 0]) * np.cos(3 * grid[:, 1])
    mesh.vertices.foreach_set("co", positions)
    mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), bool))
    mesh.materials.append(look)
    mesh.update()


def instances():
    """As many monkeys on a plane, on the vertices of another mesh."""
    elements.floor(size=8)
    bpy.ops.mesh.primitive_monkey_add(size=0.02)
    monkey = bpy.context.object
    monkey.data.materials.append(elements.chalk((0.7, 0.3, 0.2)))
    rng = np.random.default_rng(1)
    points = bpy.data.meshes.new("points")
    points.from_pydata(rng.uniform((-4, -4, 0.01), (4, 4, 0.5), (PLACES, 3)).tolist(), [], [])
    parent = bpy.data.objects.new("points", points)
    bpy.context.scene.collection.objects.link(parent)
    monkey.parent = parent
    parent.instance_type = "VERTS"


def measure(name, build):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    build()
    elements.camera()
    elements.light("POINT", energy=300, shadow_soft_size=0.2)
    scene = bpy.context.scene
    scene.render.engine = "BDPM"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 640, 480, 100
    scene.bdpm.use_error, scene.bdpm.time = False, 8
    first = []
    own = engine._Picture.show
    engine._Picture.show = lambda self, channels: (first.append(time.monotonic()), own(self, channels))
    try:
        for turn in ("first", "again, with the camera moved"):
            first.clear()
            start = time.monotonic()
            bpy.ops.render.render()
            report = bdpm_render.reports.of(scene.name)
            seconds = report.answer["seconds"]
            print(
                f":: {name}, {turn}: export {report.export_seconds:.1f} s, load {seconds['load']:.1f} s, "
                f"build {seconds['build']:.1f} s, first picture after {first[0] - start:.1f} s",
                flush=True,
            )
            scene.camera.location.x += 0.3
    finally:
        engine._Picture.show = own
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f":: {name}: at most {peak:.0f} MiB in Blender so far", flush=True)


bdpm_render.register()
if os.environ.get("BDPM"):
    engine.program_path = lambda: os.environ["BDPM"]
measure("10^6 triangles", million)
measure("10^5 instances", instances)
