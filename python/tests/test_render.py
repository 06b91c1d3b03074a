"""Rendering: equal to the program, in the background, and with an end by the user."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import bdpm
import numpy as np
import pytest

SIZE = (24, 16)
FIXED: dict[str, Any] = {"iterations": 8, "light_paths": 500, "camera_paths": 2, "resolution": SIZE, "seed": 3}


def fixed(scene: bdpm.Scene, **more: Any) -> bdpm.RenderResult:
    return bdpm.render(scene, **{**FIXED, **more})


def test_image_and_layers_are_those_of_the_program(box: bdpm.Scene, program: str, tmp_path: Path) -> None:
    exr = tmp_path / "box.exr"
    options = "--iterations 8 --light-paths 500 --camera-paths 2 --resolution 24x16 --seed 3 --quiet".split()
    subprocess.run([program, "render", "scenes/cornell-box", "--output", exr, *options], check=True)
    expected = bdpm.read_exr(exr)
    result = fixed(box)
    np.testing.assert_array_equal(result.image, expected.pop(""))
    assert result.layers.keys() == expected.keys() and "albedo" in expected
    for name, layer in expected.items():
        np.testing.assert_array_equal(result.layers[name], layer, err_msg=name)
    own = tmp_path / "own.exr"
    result.save(own)
    for name, layer in bdpm.read_exr(own).items():
        np.testing.assert_array_equal(layer, expected[name] if name else result.image, err_msg=name)
    assert [own.name] == [path.name for path in tmp_path.glob("own*")], "no other file is written"


def test_image_is_one_writable_float_array_without_copies(box: bdpm.Scene) -> None:
    result = fixed(box)
    assert result.image.dtype == np.float32 and result.image.shape == (16, 24, 3)
    assert result.image is result.image and result.image.flags.c_contiguous
    result.image[0, 0] = 7.0
    assert (result.image[0, 0] == 7.0).all()
    image = result.image
    del result
    assert (image[0, 0] == 7.0).all(), "the array outlives the result"


@pytest.mark.parametrize("time", [0.2, "0.2", "200ms"])
def test_time_is_seconds_or_text(box: bdpm.Scene, time: float | str) -> None:
    result = bdpm.render(box, time=time, resolution=SIZE, strategy="single", radius=20, light_paths=100, camera_paths=1)
    assert result.stopped_by == "time" and result.seconds < 20


def test_interrupted_result_states_the_error_that_it_reached(box: bdpm.Scene) -> None:
    result = bdpm.render(box, time=600, resolution=SIZE, progress=lambda progress: progress.iterations < 8)
    assert result.stopped_by == "interrupt" and result.iterations >= 8
    assert result.error is not None and result.error.total >= result.error.noise > 0


def test_missing_folder_is_named_without_temporary_file(box: bdpm.Scene, tmp_path: Path) -> None:
    result = fixed(box)
    for name in ["a.exr", "a.png"]:
        path = tmp_path / "none" / name
        with pytest.raises(bdpm.Error, match="its folder does not exist") as error:
            result.save(path)
        assert error.value.file == str(path) and "mkdir -p" in error.value.help
        assert ".tmp" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_layers_of_light_add_up_to_the_image(box: bdpm.Scene) -> None:
    result = fixed(box)
    parts = [result.layers[name] for name in ("emission", "direct", "indirect", "caustics")]
    np.testing.assert_allclose(sum(parts), result.image, rtol=1e-4, atol=1e-6)
    assert result.layers["depth"].shape == (16, 24) and result.layers["rms"].shape == (16, 24)
    assert fixed(box, layers=["albedo"]).layers.keys() == {"albedo", "rms"}
    assert fixed(box, layers=[]).layers.keys() == {"rms"}


def test_automatic_render_reports_its_error_and_repeats_by_its_plan(box: bdpm.Scene) -> None:
    result = bdpm.render(box, time=1.5, resolution=(32, 32))
    assert result.stopped_by == "time" and result.error is not None and result.rms is not None
    assert 0 < result.error.noise <= result.error.total == float(result.error)
    assert result.rms.error is not None and result.settings["width"] == 32
    again = bdpm.render(box, plan=result.plan)
    np.testing.assert_array_equal(again.image, result.image)
    with pytest.raises(bdpm.Error, match="this plan is for another image"):
        bdpm.render(box, plan=result.plan, seed=99)


def test_jobs_at_once_are_equal_to_jobs_alone(box: bdpm.Scene) -> None:
    jobs = [bdpm.start(box, **{**FIXED, "seed": seed, "iterations": 40}) for seed in (3, 4, 3)]
    first, other, second = (job.result().image for job in jobs)
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(first, fixed(box, iterations=40).image)
    assert (first != other).any()


def test_other_threads_run_while_a_render_waits(box: bdpm.Scene) -> None:
    turns = 0
    stop = threading.Event()

    def count() -> None:
        nonlocal turns
        while not stop.is_set():
            turns += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    before = turns
    bdpm.render(box, time=1.0, resolution=(64, 64))
    stop.set()
    thread.join()
    # 50 polls of the waiting thread alone would give a few turns each; a held lock none at all.
    assert turns - before > 50


def test_callback_sees_growing_progress_and_ends_the_render(box: bdpm.Scene) -> None:
    seen: list[bdpm.Progress] = []

    def callback(progress: bdpm.Progress) -> bool:
        seen.append(progress)
        return progress.iterations < 5

    result = bdpm.render(box, iterations=10**9, light_paths=500, resolution=SIZE, progress=callback)
    assert result.stopped_by == "interrupt" and 5 <= result.iterations < 10**9
    assert [p.iterations for p in seen] == sorted(p.iterations for p in seen) and seen[-1].iterations >= 5


def test_exception_of_the_callback_ends_the_render(box: bdpm.Scene) -> None:
    def callback(progress: bdpm.Progress) -> None:
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        bdpm.render(box, iterations=10**9, resolution=SIZE, progress=callback)


def test_ctrl_c_returns_the_image_so_far(box: bdpm.Scene) -> None:
    def callback(progress: bdpm.Progress) -> None:
        if progress.iterations > 0 and not sent:
            sent.append(True)
            os.kill(os.getpid(), signal.SIGINT)

    sent: list[bool] = []
    result = bdpm.render(box, iterations=10**9, light_paths=500, resolution=SIZE, progress=callback)
    assert sent and result.stopped_by == "interrupt" and result.iterations >= 1
    assert result.image.max() > 0


def test_exception_of_a_signal_handler_is_raised(box: bdpm.Scene) -> None:
    def too_late(number: int, frame: object) -> None:
        raise TimeoutError("too late")

    old = signal.signal(signal.SIGALRM, too_late)
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    try:
        with pytest.raises(TimeoutError, match="too late"):
            bdpm.render(box, iterations=10**9, light_paths=500, resolution=SIZE)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, old)


def test_job_shows_the_image_so_far(box: bdpm.Scene) -> None:
    job = bdpm.start(box, iterations=10**9, light_paths=500, resolution=SIZE)
    while job.progress.iterations == 0:
        time.sleep(0.01)
    image = job.image
    assert image is not None and image.shape == (16, 24, 3) and image.max() > 0
    png = job._repr_png_()
    assert png is not None and png.startswith(b"\x89PNG") and not job.done
    job.stop()
    result = job.result()
    assert job.done and job.result() is result and job.image is result.image


def test_deleted_job_ends(box: bdpm.Scene) -> None:
    def threads() -> int:
        return len(list(Path("/proc/self/task").iterdir()))

    before = threads()
    job = bdpm.start(box, iterations=10**9, light_paths=500, resolution=SIZE)
    assert threads() > before
    del job
    # Threads of the pool end a little later.
    end = time.monotonic() + 60
    while threads() > before and time.monotonic() < end:
        time.sleep(0.01)
    assert threads() <= before


def test_interpreter_exits_while_a_job_runs() -> None:
    code = (
        "import bdpm\n"
        "job = bdpm.start(bdpm.load('scenes/cornell-box'), iterations=10**9, resolution=(64, 64))\n"
        "print('started')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, "started\n", "")


def test_png_is_that_of_the_program(box: bdpm.Scene, program: str, tmp_path: Path) -> None:
    options = "--iterations 8 --light-paths 500 --camera-paths 2 --resolution 24x16 --seed 3 --quiet".split()
    subprocess.run(
        [program, "render", "scenes/cornell-box", "--output", tmp_path / "a.exr", *options, "--tonemap", "agx"],
        check=True,
    )
    result = fixed(box)
    assert result.to_png(tonemap="agx") == (tmp_path / "a.png").read_bytes()
    result.save(tmp_path / "b.png", tonemap="agx")
    assert (tmp_path / "b.png").read_bytes() == (tmp_path / "a.png").read_bytes()
    assert result._repr_png_() == result.to_png() != result.to_png(exposure=1.0)


@pytest.mark.parametrize(
    ("arguments", "error", "expected"),
    [
        ({"raduis": 1}, TypeError, "unknown keyword `raduis`: use one of .*, radius, "),
        ({"tme": 3}, TypeError, "unknown keyword `tme`: use one of time, target_error, "),
        ({"radius": "x"}, bdpm.Error, "`x` is not a length"),
        ({"light_paths": 0}, bdpm.Error, "light"),
        ({"time": -1}, ValueError, "time: `-1` is a negative time: give a time above 0"),
        ({"time": "soon"}, ValueError, "time: `soon` is no time"),
        ({"time": [3]}, TypeError, "time is of type list: give seconds"),
        ({"target_error": 0}, ValueError, "target_error is 0"),
        ({"target_rms": "much"}, bdpm.Error, "much"),
        ({"time": 0}, ValueError, "time of 0: give a time above 0"),
        ({"time": 1e-12}, ValueError, "time of 0: give a time above 0"),
        ({"objective": "least"}, ValueError, "use one of relative"),
        ({"layers": ["albdo"]}, ValueError, "use one of all"),
        ({"accel": "gpu"}, ValueError, "use one of embree, bvh"),
        ({"crop": (0, 0, 999, 1), "resolution": SIZE, "iterations": 1}, bdpm.Error, "crop|window"),
        ({"seed": object()}, TypeError, "seed is of type object"),
    ],
)
def test_bad_argument_is_refused(
    box: bdpm.Scene, arguments: dict[str, Any], error: type[Exception], expected: str
) -> None:
    with pytest.raises(error, match=expected):
        bdpm.render(box, **arguments)
