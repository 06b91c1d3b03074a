"""Bad cases for blender_check.py: each ends in a clear report, with Blender usable and no file left behind."""

import glob
import os
import shutil
import signal
import stat
import subprocess
import tempfile
import threading
import time

import bdpm_render
import blender_elements as elements
import bpy
import numpy as np
from bdpm_render import engine

CASES = []


def case(check):
    CASES.append(check)
    return check


def run(prepare):
    """Names of the cases that failed."""
    failed = []
    home = engine.program_path
    for check in CASES:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.preferences.addon_enable(module="cycles")
        prepare(bpy.context.scene)
        scene = bpy.context.scene
        scene.render.engine = "BDPM"
        scene.render.resolution_x = scene.render.resolution_y = 32
        scene.bdpm.iterations, scene.bdpm.options = 2, "--light-paths 1000 --camera-paths 1"
        before, threads = left_behind(), threading.active_count()
        folder = tempfile.mkdtemp(prefix="blender-bad-")
        try:
            check(scene, folder)
            assert left_behind() == before, f"left behind: {left_behind() - before}"
            assert threading.active_count() <= threads + 1, "left threads behind"
            print(f":: bad case {check.__name__:32} ok", flush=True)
        except Exception as error:  # noqa: BLE001, each failure is printed and counted
            failed.append(check.__name__)
            print(f":: bad case {check.__name__:32} BAD  {type(error).__name__}: {error}", flush=True)
        finally:
            engine.program_path = home
            os.environ.pop("TMPDIR", None)
            tempfile.tempdir = None
            shutil.rmtree(folder, ignore_errors=True)
    return failed


def left_behind():
    return set(glob.glob(os.path.join(tempfile.gettempdir(), f"bdpm-{os.getpid()}-*")))


def render(scene, folder):
    """The report of a render. Blender itself raises an error after an engine's."""
    scene.render.filepath = os.path.join(folder, "out.exr")
    bdpm_render.reports.begin(scene.name)
    try:
        bpy.ops.render.render(write_still=True)
    except RuntimeError:
        pass
    return bdpm_render.reports.of(scene.name)


def fails(scene, folder, *words):
    report = render(scene, folder)
    assert report.error, "there was no error"
    for word in words:
        assert word in report.error, f"no `{word}` in `{report.error}`"


def works(scene, folder):
    report = render(scene, folder)
    assert not report.error, report.error
    assert os.path.getsize(os.path.join(folder, "out.exr")) > 0
    return report


def good_scene():
    elements.stage()
    elements.light("POINT", energy=100)


def script(folder, text):
    """A program of these lines."""
    path = os.path.join(folder, "bdpm")
    with open(path, "w") as file:
        file.write("#!/bin/sh\n" + text)
    os.chmod(path, os.stat(path).st_mode | stat.S_IXUSR)
    return path


@case
def no_program(scene, folder):
    good_scene()
    engine.program_path = lambda: os.path.join(folder, "missing")
    fails(scene, folder, "missing", "Preferences")
    engine.program_path = lambda: ""
    path, os.environ["PATH"] = os.environ["PATH"], folder
    try:
        fails(scene, folder, "was not found", "cargo build")
    finally:
        os.environ["PATH"] = path


@case
def old_program(scene, folder):
    good_scene()
    engine.program_path = lambda: script(folder, "[ $1 = --version ] && echo bdpm 0.0.1 || echo --output\n")
    fails(scene, folder, "0.0.1", "older than this add-on")


@case
def other_program(scene, folder):
    good_scene()
    engine.program_path = lambda: script(folder, "echo I am somebody else\n")
    fails(scene, folder, "another program")


@case
def program_that_does_not_run(scene, folder):
    good_scene()
    path = script(folder, "echo broken libraries >&2; exit 127\n")
    engine.program_path = lambda: path
    fails(scene, folder, "does not run", "broken libraries")
    os.chmod(path, 0o600)
    os.utime(path, (1, 1))
    fails(scene, folder, "does not run")


@case
def nothing_to_render(scene, folder):
    elements.camera()
    elements.light("POINT")
    fails(scene, folder, "nothing to render")


@case
def no_camera(scene, folder):
    elements.ball()
    elements.light("POINT")
    report = render(scene, folder)
    # Blender itself refuses, before it asks the engine.
    assert not os.path.exists(scene.render.filepath) and not report.answer


@case
def other_cameras(scene, folder):
    good_scene()
    scene.camera.data.type = "PANO"
    fails(scene, folder, "pano", "perspective")


@case
def no_light(scene, folder):
    elements.stage()
    fails(scene, folder, "no light", "world")


@case
def wrong_option(scene, folder):
    good_scene()
    scene.bdpm.options = "--no-such-option"
    fails(scene, folder, "no-such-option")
    scene.bdpm.options = '--output "one image.exr'
    fails(scene, folder, "Options", "quotation")


@case
def quoted_option(scene, folder):
    good_scene()
    noise = os.path.join(folder, "its noise.exr")
    scene.bdpm.options = f'--camera-paths 2 --noise "{noise}"'
    works(scene, folder)
    assert os.path.exists(noise)


@case
def missing_texture(scene, folder):
    look = elements.chalk()
    node = elements.textured(look, "Color")
    node.image = bpy.data.images.new("gone", 4, 4)
    node.image.source, node.image.filepath = "FILE", "//gone.png"
    elements.floor(look)
    elements.camera()
    elements.light("POINT")
    report = works(scene, folder)
    assert any("gone" in line for line in report.remarks), report.remarks


@case
def wrong_abbe_numbers(scene, folder):
    """Each is reported and left out; numbers of the right kind are taken as they are."""
    for number, (abbe, is_glass) in enumerate((("dense", True), (1.0, True), (40, False), (64, True), (26.5, True))):
        look = elements.shader("ShaderNodeBsdfGlass")[0] if is_glass else elements.chalk()
        look.name, look["abbe"] = f"look {number}", abbe
        elements.ball(look).location.x = 3 * number
    elements.floor()
    elements.camera()
    elements.light("POINT")
    remarks = works(scene, folder).remarks
    for number, words in enumerate(("not a number", "not a number", "it is not glass")):
        assert any(f"look {number}" in line and words in line for line in remarks), (number, remarks)
    assert not any(f"look {number}" in line for number in (3, 4) for line in remarks), remarks


@case
def missing_ies_files(scene, folder):
    """A file that is not there, a text that is no IES file, and neither: each is named, and the light still shines."""
    elements.stage()
    broken = bpy.data.texts.new("broken text")
    broken.write("no such format")
    for path, text in (("gone.ies", None), (None, broken), (None, None)):
        lamp = elements.light("POINT", energy=1)
        node = elements.ies(lamp, os.path.join(folder, path) if path else None)
        if path is None:
            node.mode, node.ies = "INTERNAL", text
    remarks = works(scene, folder).remarks
    for word in (os.path.join(folder, "gone.ies"), "broken text", "none is selected"):
        assert any(word in line for line in remarks), (word, remarks)


@case
def packed_and_other_textures(scene, folder):
    """Packed, on disk with letters beyond ASCII, and generated."""
    for number, name in enumerate(("packed", "Tür ñ 日本", "generated")):
        look = elements.chalk()
        node = elements.textured(look, "Color", name=name)
        if number == 1:
            node.image.filepath_raw = os.path.join(folder, f"{name}.png")
            node.image.file_format = "PNG"
            node.image.save()
            path = node.image.filepath_raw
            node.image = bpy.data.images.load(path)
        elif number == 2:
            node.image = bpy.data.images.new("grid", 64, 64)
            node.image.source, node.image.generated_type = "GENERATED", "COLOR_GRID"
        elements.floor(look).location.x = 3 * number
    elements.camera()
    elements.light("POINT")
    assert not works(scene, folder).remarks


@case
def broken_geometry(scene, folder):
    good_scene()
    mesh = bpy.data.meshes.new("broken")
    mesh.from_pydata(
        [(0, 0, float("nan")), (1, 0, 0), (0, float("inf"), 0), (1, 1, 1)], [], [(0, 1, 2), (1, 2, 3), (1, 1, 2)]
    )
    for place in ((0, 0, 0), (1, 1, 1)):
        one = bpy.data.objects.new("broken", mesh)
        one.location = place
        scene.collection.objects.link(one)
    empty = bpy.data.objects.new("empty", bpy.data.meshes.new("empty"))
    scene.collection.objects.link(empty)
    elements.floor().scale = (1, 1, 0)
    flat = elements.ball()
    flat.scale = (1, 0, 1)
    gone = elements.ball()
    gone.scale = (0, 0, 0)
    report = works(scene, folder)
    assert any("no numbers" in line for line in report.remarks), report.remarks


@case
def strange_names(scene, folder):
    elements.floor(elements.chalk())
    for name in ('a "quoted" \\ name', "Grün 日本\n\t", "[materials]", "a.b", ""):
        look = elements.shader("ShaderNodeBsdfDiffuse", "x")[0]
        look.name = name
        elements.ball(look)
    elements.camera()
    elements.light("POINT")
    works(scene, folder)


@case
def paths_with_spaces_and_letters(scene, folder):
    good_scene()
    place = os.path.join(folder, "ein Ordner für ñ 日本")
    os.mkdir(place)
    path = os.path.join(place, "bdpm")
    os.symlink(engine.program_path(), path)
    engine.program_path = lambda: path
    os.environ["TMPDIR"], tempfile.tempdir = place, None
    works(scene, place)
    assert not glob.glob(os.path.join(place, "bdpm-*"))


@case
def full_disk(scene, folder):
    """A folder that nothing can be written to stands for one."""
    good_scene()
    os.environ["TMPDIR"] = folder
    tempfile.tempdir = os.path.join(folder, "missing")
    fails(scene, folder, "missing")


def later(seconds, action):
    timer = threading.Timer(seconds, action)
    timer.start()
    return timer


def children():
    """Programs that render, started by this process."""
    found = subprocess.run(["ps", "-o", "pid=,args=", "--ppid", str(os.getpid())], capture_output=True, text=True)
    return [int(line.split()[0]) for line in found.stdout.splitlines() if " render " in line]


@case
def killed_program(scene, folder):
    good_scene()
    scene.bdpm.iterations = 1000000
    timer = later(1.5, lambda: [os.kill(pid, signal.SIGKILL) for pid in children()])
    fails(scene, folder, "SIGKILL")
    timer.join()
    scene.bdpm.iterations = 2
    works(scene, folder)


@case
def escape_at_every_stage(scene, folder):
    """Whether Escape was pressed is asked through `is_stopped`; the picture that there is comes back."""
    good_scene()
    scene.bdpm.iterations = 1000000
    own = engine.BdpmEngine.is_stopped
    try:
        for seconds in (0.0, 0.02, 0.2, 2.0):
            start = time.monotonic()
            engine.BdpmEngine.is_stopped = lambda self, end=start + seconds: time.monotonic() >= end
            report = render(scene, folder)
            took = time.monotonic() - start
            assert not report.error and not children(), report.error
            assert took < seconds + 20, took
            if seconds >= 2:
                assert report.answer["stopped_by"] == "interrupt" and report.answer["iterations"] > 0, report.answer
    finally:
        engine.BdpmEngine.is_stopped = own
    scene.bdpm.iterations = 2
    works(scene, folder)


@case
def unsaved_and_two_view_layers(scene, folder):
    """The file was never saved; a second layer sees less, and a second scene is its own."""
    good_scene()
    layer = scene.view_layers.new("second")
    kept = bpy.data.collections.new("only first")
    scene.collection.children.link(kept)
    one = elements.ball(location=(2, 0, 1))
    for collection in list(one.users_collection):
        collection.objects.unlink(one)
    kept.objects.link(one)
    layer.layer_collection.children["only first"].exclude = True
    assert not bpy.data.filepath
    works(scene, folder)
    other = scene.copy()
    other.name = "other"
    other.bdpm.seed = 7
    assert scene.bdpm.seed == 1
    scene.render.use_border = True
    scene.render.border_min_x, scene.render.border_max_x = 0.5, 0.75
    os.remove(scene.render.filepath)
    works(scene, folder)


@case
def all_passes_come_back(scene, folder):
    """All passes reach the file, and their sum is the picture."""
    good_scene()
    layer = scene.view_layers[0]
    layer.use_pass_z = layer.use_pass_normal = True
    seen = {}
    own = engine.passes.put

    def put(result_layer, passes):
        own(result_layer, passes)
        seen.update({one.name: one.channels for one in result_layer.passes}, values=passes)

    engine.passes.put = put
    try:
        works(scene, folder)
    finally:
        engine.passes.put = own
    values = seen["values"]
    for name in ("Combined", "Normal", "Albedo", "Direct", "Indirect", "Caustics", "Emission Light", "Error", "Depth"):
        assert name in seen and name in values, (name, list(seen))
    total = sum(values[name] for name in ("Direct", "Indirect", "Caustics", "Emission Light"))
    assert np.allclose(total, values["Combined"][..., :3], atol=1e-4 + 1e-4 * total.max())


@case
def the_engine_comes_and_goes(scene, folder):
    bdpm_render.unregister()
    bdpm_render.register()
    bpy.context.scene.render.engine = "BDPM"
    good_scene()
    scene.bdpm.iterations, scene.bdpm.use_iterations = 2, True
    works(scene, folder)
