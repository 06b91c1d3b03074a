"""The render engine: exports the evaluated scene, runs the program, and brings its image into Blender."""

import os
import shlex
import shutil
import tempfile
import time
import traceback

import bpy

from . import exr, passes, program, reports, tev
from .export import camera
from .export.error import ExportError
from .export.scene import SceneWriter
from .preferences import program_path

POLL = 0.05
# Seconds after Escape in which the program may finish its iteration.
PATIENCE = 30.0


class BdpmEngine(bpy.types.RenderEngine):
    """Bidirectional photon mapping that knows its own noise."""

    bl_idname = "BDPM"
    bl_label = "BDPM"
    bl_use_preview = False
    bl_use_postprocess = True
    bl_use_shading_nodes_custom = False
    bl_use_eevee_viewport = True

    def update_render_passes(self, scene=None, renderlayer=None):
        """Tells compositor and passes panel what there is."""
        self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
        if renderlayer.use_pass_z:
            self.register_pass(scene, renderlayer, "Depth", 1, "Z", "VALUE")
        if renderlayer.use_pass_normal:
            self.register_pass(scene, renderlayer, "Normal", 3, "XYZ", "VECTOR")
        for name, channels, letters, kind in passes.wanted(scene.bdpm):
            self.register_pass(scene, renderlayer, name, channels, letters, kind)

    def render(self, depsgraph):
        """F12, a frame of an animation, or one from the command line."""
        folder = None
        report = reports.begin(depsgraph.scene.name)
        left, bottom, right, top = camera.region(depsgraph.scene)
        picture = _Picture(self, depsgraph, (right - left, top - bottom))
        try:
            path = program.find(program_path())
            program.check(path)
            folder = tempfile.mkdtemp(prefix=f"bdpm-{os.getpid()}-")
            self._render(depsgraph, path, folder, report, picture)
        except (program.ProgramError, ExportError) as error:
            self._fail(report, str(error))
        except (OSError, MemoryError, exr.ExrError) as error:
            self._fail(report, f"{type(error).__name__}: {error}")
        except Exception as error:  # whatever a file holds, Blender goes on
            traceback.print_exc()
            what = f"{type(error).__name__}: {error}"
            self._fail(report, f"The add-on failed: {what}. The console has more; report this as a bug")
        finally:
            picture.ensure()
            if folder:
                shutil.rmtree(folder, ignore_errors=True)

    def is_stopped(self):
        """Whether the user pressed Escape."""
        return self.test_break()

    def _fail(self, report, text):
        report.error = text
        self.report({"ERROR"}, text)

    def _render(self, depsgraph, path, folder, report, picture):
        scene = depsgraph.scene
        self.update_stats("", "BDPM: reading the scene")
        start = time.monotonic()
        exported = SceneWriter(folder).write(depsgraph, self.is_stopped)
        if exported is None:
            return
        report.remarks = exported.remarks
        report.export_seconds = time.monotonic() - start
        if exported.remarks:
            what = f"{len(exported.remarks)} things are approximated or ignored"
            self.report({"INFO"}, f"BDPM: {what}; the panel Not as in Blender lists them")
        image = os.path.join(folder, "image.exr")
        receiver = tev.Receiver()
        run = program.Render(
            path, [*_arguments(scene.bdpm, image), "--view=" + receiver.address, exported.path], folder
        )
        try:
            was_stopped = self._watch(run, receiver, picture, scene.bdpm)
            self._bring(run, image, picture, was_stopped, report)
        finally:
            run.kill()
            receiver.close()

    def _watch(self, run, receiver, picture, settings):
        """Shows how far it is until the program ends. Whether it was stopped."""
        stopped, shown = None, ""
        while run.is_running():
            if stopped is None and self.is_stopped():
                stopped = time.monotonic()
                run.interrupt()
                self.update_stats("", "BDPM: stopping")
            if stopped is not None and time.monotonic() - stopped > PATIENCE:
                run.kill()
            channels = receiver.take()
            if channels is not None:
                picture.show(channels)
            told = _told(run, settings)
            if stopped is None and told != shown:
                shown = told
                self.update_stats("", told)
                self.update_progress(run.status.get("done") or 0.0)
            time.sleep(POLL)
        return stopped is not None

    def _bring(self, run, image, picture, was_stopped, report):
        try:
            answer = run.finish()
        except program.ProgramError:
            if was_stopped:
                self.report({"INFO"}, "Stopped before the image was written; what was shown is kept")
                return
            raise
        finally:
            report.notes = list(run.notes)
        picture.bring(exr.read(image))
        report.answer = answer


def _arguments(settings, image):
    arguments = ["--output", image, "--json", "--seed", str(settings.seed)]
    if settings.use_error:
        arguments += ["--target-error", f"{settings.error:g}%"]
    if settings.use_time:
        arguments += ["--time", f"{max(settings.time, 0.1):.1f}s".replace(".0s", "s")]
    arguments.append("--denoise" if settings.use_denoising else "--no-denoise")
    if settings.threads:
        arguments += ["--threads", str(settings.threads)]
    if settings.use_iterations:
        arguments += ["--iterations", str(settings.iterations)]
    try:
        return arguments + shlex.split(settings.options)
    except ValueError as error:
        raise program.ProgramError(f"Options of the panel, {settings.options!r}: {error}") from error


def _told(run, settings):
    """The status line."""
    status = run.status
    if not status:
        return f"BDPM: {run.said or 'loading'}"
    parts = ["BDPM"]
    if status.get("seconds_left") is not None:
        parts.append(f"{_clock(status['seconds_left'])} left")
    if status.get("error") is not None:
        parts.append(f"error {100 * status['error']:.2f} %")
    if status.get("promised") is not None:
        parts.append(f"{100 * status['promised']:.2f} % at the end")
    elif settings.use_error and not settings.use_time:
        parts.append(f"up to {settings.error:g} %")
    return " | ".join([*parts, f"{status['iterations']} iterations"])


def _clock(seconds):
    minutes, seconds = divmod(int(round(seconds)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"


class _Picture:
    """What Blender shows of a view layer."""

    def __init__(self, engine, depsgraph, size):
        self._engine, self._size = engine, size
        self._layer = depsgraph.view_layer.name
        scene = depsgraph.scene
        self._settings, self._exposure = scene.bdpm, 2**scene.bdpm.exposure
        self._transparent = scene.render.film_transparent
        self._passes = passes.wanted(scene.bdpm)
        self._is_begun = False

    def ensure(self):
        """A black picture if there is none: without any, Blender crashes where it writes EXR files."""
        if not self._is_begun:
            self._engine.end_result(self._begin())

    def show(self, channels):
        """The picture so far."""
        if channels["R"].shape != self._size[::-1]:
            return
        result = self._begin()
        name = "denoised." if "denoised.R" in channels else ""
        shown = {letter: channels[name + letter] for letter in "RGB"}
        passes.put(result.layers[0], {"Combined": passes.combined(shown, self._exposure)})
        self._engine.update_result(result)
        self._engine.end_result(result, cancel=False, do_merge_results=False)

    def bring(self, channels):
        """The picture as it is at the end, with all passes."""
        background = self._background(channels) if self._transparent else None
        result = self._begin()
        passes.put(result.layers[0], passes.of(channels, self._settings, self._exposure, background))
        self._engine.end_result(result)

    def _begin(self):
        self._is_begun = True
        for name, channels, letters, _ in self._passes:
            self._engine.add_pass(name, channels, letters)
        return self._engine.begin_result(0, 0, *self._size, layer=self._layer)

    def _background(self, channels):
        """What the camera sees where there is no surface: the light that it sees directly there."""
        alpha = channels["alpha.Y"]
        seen = passes.np.stack([channels[f"emission.{letter}"] for letter in "RGB"], axis=-1)
        return seen / passes.np.maximum(1 - alpha, 1e-6)[..., None] * (alpha < 1)[..., None]
