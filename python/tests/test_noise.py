"""Noise: equal to the program, and a law that holds."""

import json
import subprocess
from pathlib import Path
from typing import Any

import bdpm
import numpy as np
import pytest

SIZE = (16, 16)


@pytest.fixture(scope="module")
def noise(box: bdpm.Scene) -> bdpm.Noise:
    return bdpm.analyze(box, iterations=64, light_paths=300, camera_paths=2, resolution=SIZE)


@pytest.fixture(scope="module")
def timings(box: bdpm.Scene) -> bdpm.Timings:
    return bdpm.calibrate(box, time=0.5, resolution=SIZE)


def test_noise_file_is_that_of_the_program(noise: bdpm.Noise, program: str, tmp_path: Path) -> None:
    exr, own = tmp_path / "noise.exr", tmp_path / "own.exr"
    options = "--iterations 64 --light-paths 300 --camera-paths 2 --resolution 16x16 --quiet".split()
    subprocess.run([program, "analyze", "scenes/cornell-box", "--output", exr, *options], check=True)
    noise.save(own)
    assert own.read_bytes() == exr.read_bytes()
    read = bdpm.Noise.load(exr)
    for name in ("a", "b", "f", "sampled_variance", "luminance"):
        array = getattr(noise, name)
        assert array.shape == (16, 16) and array.dtype == np.float32
        np.testing.assert_array_equal(getattr(read, name), array)
    assert (read.iterations, read.light_paths, read.camera_paths) == (64, 300, 2)


def test_prediction_follows_the_law_and_the_program(noise: bdpm.Noise, program: str, tmp_path: Path) -> None:
    prediction = noise.predict(light_paths=5000, camera_paths=8, region="side-walls")
    exr = tmp_path / "noise.exr"
    noise.save(exr)
    options = ["--light-paths", "5000", "--camera-paths", "8", "--region", "side-walls", "--json"]
    done = subprocess.run([program, "predict", exr, *options], check=True, capture_output=True)
    [expected] = json.loads(done.stdout)["predictions"]
    # The file holds 32-bit floats.
    assert prediction.pooled_rms.value == pytest.approx(expected["pooled_rms"]["value"], rel=1e-4)
    assert prediction.pooled_rms.error == pytest.approx(expected["pooled_rms"]["error"], rel=1e-3)
    whole = noise.predict(light_paths=5000, camera_paths=8)
    a, b, f = (np.float64(c).mean() for c in (noise.a, noise.b, noise.f))
    assert whole.pooled_rms.value == pytest.approx(np.sqrt(a / 40000 + b / 8 + f / 5000), rel=1e-5)


def test_calibrated_times_predict_and_optimize(box: bdpm.Scene, noise: bdpm.Noise, timings: bdpm.Timings) -> None:
    parts = timings.parts(light_paths=1000, camera_paths=3)
    tau = timings.iteration(light_paths=1000, camera_paths=3)
    assert tau == pytest.approx(sum(parts)) and min(parts) >= 0 and tau > 0
    prediction = noise.predict(light_paths=1000, camera_paths=3, timings=timings, time=10)
    assert prediction.iterations == pytest.approx(10 / tau) and prediction.pooled_rms_after is not None
    best = noise.optimize(timings, time=10, objective="pooled")
    assert best.rms_after is not None and best.light_paths >= 1
    # The recommended iteration is the shortest within 1 % of the least cost.
    assert best.rms_after.value <= 1.01 * prediction.pooled_rms_after.value
    result = bdpm.render(box, plan=best.plan, iterations=2)
    assert result.plan.steps == [(best.light_paths, best.camera_paths, 2)]
    to_target = noise.optimize(timings, target_rms="1%", objective="pooled")
    assert to_target.time_to_target is not None and to_target.time_to_target.value > 0


def test_optimized_counts_of_pixels_are_an_array(box: bdpm.Scene, noise: bdpm.Noise, timings: bdpm.Timings) -> None:
    best = noise.optimize(timings, time=10, per_pixel=True)
    counts = best.camera_paths
    assert isinstance(counts, np.ndarray) and counts.shape == (16, 16) and counts.dtype == np.uint32
    assert counts.min() >= 1 and {row["name"] for row in best.rows} >= {"uniform", "per-pixel"}
    assert bdpm.render(box, plan=best.plan, iterations=2, seed=5).settings["seed"] == 5


def test_times_survive_a_file(timings: bdpm.Timings, tmp_path: Path) -> None:
    path = tmp_path / "times.json"
    timings.save(path)
    read = bdpm.Timings.load(path)
    names = ("fixed", "light_path", "camera_path", "look_up", "merge_pair")
    assert [getattr(read, name) for name in names] == [getattr(timings, name) for name in names]
    assert str(read) == str(timings)


def test_times_of_another_resolution_are_refused(box: bdpm.Scene, timings: bdpm.Timings) -> None:
    other = bdpm.analyze(box, iterations=2, light_paths=10, camera_paths=2, resolution=(8, 8))
    with pytest.raises(bdpm.Error, match="resolution|pixels"):
        other.optimize(timings, time=1)


def test_render_keeps_the_noise_if_asked(box: bdpm.Scene) -> None:
    options: dict[str, Any] = {"iterations": 8, "light_paths": 100, "camera_paths": 2, "resolution": SIZE}
    assert bdpm.render(box, **options).noise is None
    noise = bdpm.render(box, noise=True, **options).noise
    assert noise is not None and noise.iterations == 8 and noise.b.shape == (16, 16)


def test_too_few_iterations_are_refused(box: bdpm.Scene) -> None:
    with pytest.raises(bdpm.Error, match="too few iterations"):
        bdpm.analyze(box, iterations=1, light_paths=10, camera_paths=2, resolution=(8, 8))
    with pytest.raises(bdpm.Error, match="cannot measure the noise with 1 camera path"):
        bdpm.analyze(box, iterations=4, light_paths=10, camera_paths=1, resolution=(8, 8))
