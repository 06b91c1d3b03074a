"""Run by blender-check.sh: small scenes through the add-on and by Cycles, and bad cases."""

import os
import sys
import tempfile

import bpy
import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
sys.path[:0] = [os.path.join(ROOT, "blender"), os.path.dirname(os.path.abspath(__file__))]

import bdpm_render  # noqa: E402
import blender_elements as elements  # noqa: E402
import blender_materials  # noqa: E402, F401, adds its elements
from bdpm_render import engine, exr  # noqa: E402

SIZE, BLOCK, SEEDS = 64, 16, 4
THREADS = int(os.environ.get("THREADS", 0))
# Fixed counts: the same seed gives the same image on any machine.
OPTIONS = "--light-paths 20000 --camera-paths 4 --radius 0.4%"
ITERATIONS = 48
SAMPLES = 256
# Largest score of a block against both images' noise and one percent of its mean, which counts as equal.
LARGEST_SCORE = 5.0
UNRESOLVED = 0.01


def render(name, seed, folder, samples):
    """Linear pixels of a render by an engine, float64 of shape (height, width, 3)."""
    scene = bpy.context.scene
    scene.render.engine = name
    scene.bdpm.seed = scene.cycles.seed = seed
    scene.cycles.samples = samples
    scene.render.filepath = os.path.join(folder, "image.exr")
    bpy.ops.render.render(write_still=True)
    if name == "BDPM" and bdpm_render.reports.of(scene.name).error:
        raise RuntimeError(bdpm_render.reports.of(scene.name).error)
    channels = exr.read(scene.render.filepath)
    os.remove(scene.render.filepath)
    return np.stack([channels[letter] for letter in "RGB"], axis=-1).astype(np.float64)


def prepare(scene):
    """The settings of both engines."""
    render_settings = scene.render
    render_settings.resolution_x = render_settings.resolution_y = SIZE
    render_settings.resolution_percentage = 100
    image = render_settings.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "IMAGE"
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGB", "32"
    image.exr_codec = "ZIP"
    settings = scene.bdpm
    settings.use_error = settings.use_time = False
    settings.use_iterations, settings.iterations = True, ITERATIONS
    settings.options, settings.threads = OPTIONS, THREADS
    if THREADS:
        render_settings.threads_mode, render_settings.threads = "FIXED", THREADS
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.sample_clamp_indirect = cycles.sample_clamp_direct = cycles.blur_glossy = cycles.light_sampling_threshold = 0
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = 32
    cycles.transparent_max_bounces = cycles.volume_bounces = 32
    cycles.caustics_reflective = cycles.caustics_refractive = True


def blocks(image):
    """Means of luminance of blocks of 16 by 16 pixels."""
    height, width = (side // BLOCK * BLOCK for side in image.shape[:2])
    gray = image[:height, :width] @ np.array([0.2126, 0.7152, 0.0722])
    return gray.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).mean(axis=(1, 3)).reshape(-1)


def compare(ours, theirs):
    """Ratio of the means by channel, and scores of all blocks."""
    ratio = np.mean(ours, axis=(0, 1, 2)) / np.mean(theirs, axis=(0, 1, 2))
    a, b = (np.array([blocks(image) for image in images]) for images in (ours, theirs))
    variance = (a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / len(a)
    mean = b.mean(axis=0)
    unresolved = UNRESOLVED * np.maximum(mean, 0.1 * mean.mean())
    return ratio, (a.mean(axis=0) - mean) / np.sqrt(variance + unresolved**2)


def check(element, folder):
    """A line of the table, and whether the element is within its tolerance."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module="cycles")
    prepare(bpy.context.scene)
    element.build(bpy.context.scene)
    samples = int(SAMPLES * element.effort)
    ours = [render("BDPM", seed, folder, 0) for seed in range(1, SEEDS + 1)]
    theirs = [render("CYCLES", seed, folder, samples) for seed in range(1, SEEDS + 1)]
    ratio, scores = compare(ours, theirs)
    off = np.abs(ratio - 1).max()
    worst = np.abs(scores).max()
    good = off <= element.tolerance and (element.is_approximate or worst <= LARGEST_SCORE)
    remarks = bdpm_render.reports.of(bpy.context.scene.name).remarks
    if element.is_approximate and element.is_reported and not remarks:
        good, remarks = False, ["nothing was reported"]
    if not element.is_approximate and remarks:
        good = False
    percent = " ".join(f"{100 * (one - 1):+6.2f}" for one in ratio)
    line = f"{element.name:28} {percent} %  |z| {worst:5.1f}  {'ok' if good else 'BAD'}  {'; '.join(remarks)}"
    return line, good


def main():
    names = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    bdpm_render.register()
    engine.program_path = lambda: os.environ["BDPM"]
    failed = []
    if not names or names == ["bad"]:
        import blender_bad_cases

        failed += blender_bad_cases.run(prepare)
    with tempfile.TemporaryDirectory(prefix="blender-check-") as folder:
        for element in elements.ALL if names != ["bad"] else []:
            if names and not any(element.name.startswith(name) for name in names):
                continue
            line, good = check(element, folder)
            print("::", line, flush=True)
            failed += [] if good else [element.name]
    if failed:
        raise SystemExit(f"blender-check: failed: {', '.join(failed)}")
    print(f"blender-check: all is well (Blender {bpy.app.version_string})")


if __name__ == "__main__":
    main()
