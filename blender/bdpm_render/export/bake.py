"""Worlds of any nodes as maps of longitude and latitude, by Cycles in a second Blender: one cannot render in a render.

Run as a script it is that second Blender: `bake.py -- WORLD.blend OUT.exr WIDTH SAMPLES`.
"""

import math
import os
import subprocess
import sys
import time

WIDTH, SAMPLES = 2048, 32
# Seconds after which something is wrong.
LONGEST = 300


def bake(world, folder, has_stopped):
    """The file of a map in bdpm's directions, or None if that failed or was stopped."""
    import bpy

    library, out = (os.path.join(folder, name) for name in ("world.blend", "baked.exr"))
    bpy.data.libraries.write(library, {world}, fake_user=True)
    process = subprocess.Popen(
        [*_blender(), "--", library, out, str(WIDTH), str(SAMPLES)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    end = time.monotonic() + LONGEST
    while process.poll() is None:
        if has_stopped() or time.monotonic() > end:
            process.kill()
        time.sleep(0.05)
    return out if process.returncode == 0 and os.path.exists(out) else None


def _blender():
    """The command that runs this script in a Blender of the same version."""
    import bpy

    script = os.path.abspath(__file__)
    if bpy.app.binary_path:
        return [bpy.app.binary_path, "--background", "--factory-startup", "--python-exit-code", "1", "--python", script]
    return [sys.executable, script]


def _main(library, out, width, samples):
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module="cycles")
    with bpy.data.libraries.load(library) as (there, here):
        here.worlds = there.worlds
    scene = bpy.context.scene
    scene.world = here.worlds[0]
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    # Toward +y, with +x to the right: the middle column of bdpm's maps.
    camera.rotation_euler = (math.pi / 2, 0, 0)
    camera.data.type = "PANO"
    owner = camera.data if hasattr(camera.data, "panorama_type") else camera.data.cycles
    owner.panorama_type = "EQUIRECTANGULAR"
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    cycles.device, cycles.samples = "CPU", int(samples)
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    render.resolution_x, render.resolution_y, render.resolution_percentage = int(width), int(width) // 2, 100
    image = render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "IMAGE"
    image.file_format, image.color_mode, image.color_depth, image.exr_codec = "OPEN_EXR", "RGB", "32", "ZIP"
    render.filepath = out
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    _main(*sys.argv[sys.argv.index("--") + 1 :])
