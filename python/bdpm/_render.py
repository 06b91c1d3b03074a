"""Functions that render: the job of the extension, with progress on the screen."""

from __future__ import annotations

import atexit
import weakref
from contextlib import suppress
from typing import TYPE_CHECKING

from bdpm import _bdpm
from bdpm._bdpm import Job, Noise, RenderResult, Scene
from bdpm._progress import Callback, shown

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from bdpm._bdpm import AnalyzeOptions, RenderOptions

_jobs: weakref.WeakSet[Job] = weakref.WeakSet()


@atexit.register
def _stop_all() -> None:
    """Ends all jobs: their threads must not run while the interpreter unloads libraries."""
    running = [job for job in _jobs if not job.done]
    for job in running:
        job.stop()
    for job in running:
        with suppress(Exception):  # nobody waits for this result
            job.result()


def start(scene: Scene, **options: Unpack[RenderOptions]) -> Job:
    """Starts to render a scene in the background and returns a `Job`.

    The arguments are those of `bdpm.render`, without `progress` and `show`. Several jobs may run at once; each takes
    `threads` threads.
    """
    job = _bdpm.start(scene, **options)
    _jobs.add(job)
    return job


def render(
    scene: Scene,
    *,
    progress: bool | Callback | None = None,
    show: bool = False,
    **options: Unpack[RenderOptions],
) -> RenderResult:
    """Renders a scene and returns a `RenderResult`.

    Without other arguments than the end, short trials choose the technique and the merge radii, and the render chooses
    its path counts. Both aim at the least error. Settings that are given are not chosen.

    End of the render (default: a relative error of 1 %):

    - `time`: rendering time, seconds or text such as "2m".
    - `target_error`: relative RMS error, noise and merge bias, 0.01 for 1 %.
    - `target_rms`: pooled RMS of the noise: a luminance, W/(m^2 sr), or text such as "1%" of the mean luminance.
    - `iterations`: number of iterations; path counts are then not chosen.

    Kind of the render:

    - `objective`: aggregate of the variances to minimize: "relative", "pooled", "mean-rms" or "max-rms".
    - `plan`: a `Plan`; repeats an image, or renders the counts of `Noise.optimize`.
    - `timings`: `Timings` by which path counts are chosen.
    - `denoise`: denoise the image; the end then applies to the denoised image.
    - `layers`: names of layers for `RenderResult.layers`, such as ["albedo", "normal"] [default: all of them].
    - `noise`: keep the noise coefficients of each pixel, for `RenderResult.noise`.
    - `threads`: number of threads, without effect on the image [default: all processors].
    - `accel`: "embree" or "bvh".

    Settings, whose meaning and defaults are those of the options of `bdpm render`:

    - `resolution`: (width, height), pixels. `crop`: (left, top, width, height), pixels.
    - `light_paths`: per iteration. `camera_paths`: per pixel and iteration.
    - `radius`, `caustic_radius`: scene units, or text such as "0.5%" of the scene size.
    - `medium_scale`, `medium_share`, `medium_query`, `wavelength_width`: merging in media and of
      wavelengths.
    - `bias`: "keep" or "reduce". `kernel`: "area" or "disc". `merge_vertex`: 1 or more.
    - `strategy`: "single", "mis", "cut-mis", "path", "path-caustics", "gather" or
      "gather-caustics". `direct`: "connect" or "photon-map".
    - `guide`, `light_visibility`: numbers of iterations and shadow rays. `sobol_set`, `splitting`: of
      light paths.
    - `seed`: of all random numbers.

    Progress:

    - `progress`: a function that is called with a `Progress` up to 20 times per second; the render ends if it returns
      False. True shows a bar, False nothing. By default notebooks show a bar if tqdm is installed.
    - `show`: show the image so far in the notebook, every second.

    Other threads of Python run meanwhile. Ctrl-C ends the render, which returns the image so far; a second Ctrl-C
    raises KeyboardInterrupt.

    Raises `bdpm.Error` if a setting is wrong or the memory does not suffice.
    """
    job = start(scene, **options)
    with shown(progress, job if show else None) as callback:
        return job.result(callback)


def analyze(
    scene: Scene, *, progress: bool | Callback | None = None, **options: Unpack[AnalyzeOptions]
) -> Noise:
    """Measures the noise coefficients of each pixel at fixed path counts, and returns a `Noise`.

    - `iterations`: number of measured iterations; standard errors need 32 [default: 256, without `time`].
    - `time`: rendering time, seconds or text such as "2m".
    - `estimator`: "pairs" for all pairs of paths, or "halves" for the estimator of the paper.
    - `threads`, `accel`, `progress` and the settings: as for `bdpm.render`. Path counts are at least 2.
    """
    with shown(progress) as callback:
        return _bdpm.analyze(scene, progress=callback, **options)
