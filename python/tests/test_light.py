"""Measurements of light: meters and glare."""

import math
from pathlib import Path
from typing import Any

import bdpm
import numpy as np
import pytest

LUMENS_PER_WATT = 683.0


def floor(**more: Any) -> bdpm.Scene:
    """A black floor of 2 by 2 at y = 0."""
    mesh = bdpm.Mesh(
        [(-1, 0, -1), (-1, 0, 1), (1, 0, 1), (1, 0, -1)], [(0, 1, 2), (0, 2, 3)], material={"albedo": 0.0}
    )
    camera = {"type": "fisheye", "position": (0, 0.5, 0), "target": (0, 5, 0), "up": (0, 0, 1)}
    return bdpm.Scene.from_meshes([mesh], camera=camera, **more)


def test_meters_have_the_inverse_square_law_and_their_places() -> None:
    lamp = {"type": "point", "name": "lamp", "position": (0, 2, 0), "candela": 1000}
    meters: list[dict[str, Any]] = [
        {"name": "center", "position": (0, 0, 0), "normal": (0, 1, 0)},
        {
            "name": "grid", "corner": (-1, 0, -1), "edges": ((2, 0, 0), (0, 0, 2)), "normal": (0, 1, 0),
            "columns": 3, "rows": 2,
        },
    ]
    measured = bdpm.measure(floor(lights=[lamp]), meters=meters, target_error=0.02, by_light=True, accel="bvh")
    center, grid = measured.meters
    assert (center.name, center.quantity, center.unit) == ("center", "illuminance", "lx")
    assert center.values.shape == (1, 1) and grid.values.shape == (2, 3)
    assert float(center.mean) == pytest.approx(250, rel=1e-3)
    np.testing.assert_allclose(grid.positions[1, 0], (-2 / 3, 0, 0.5), atol=1e-6)
    np.testing.assert_allclose(grid.normals[0, 2], (0, 1, 0))
    distance2 = (grid.positions[..., 0] ** 2 + grid.positions[..., 2] ** 2) + 4
    np.testing.assert_allclose(grid.values, 1000 * 2 / distance2**1.5, rtol=1e-3)
    assert list(grid.by_light) == ["lamp"]
    np.testing.assert_allclose(grid.by_light["lamp"].values, grid.values)
    assert measured.reached and measured.seconds > 0


def test_requirements_are_judged() -> None:
    lamp = {"type": "point", "position": (0, 2, 0), "candela": 1000}
    meter = {"position": (0, 0, 0), "normal": (0, 1, 0), "required_mean": 240, "required_ugr": 19}
    (center,) = bdpm.measure(floor(lights=[lamp]), meters=[meter], target_error=0.02, accel="bvh").meters
    mean, glare = center.requirements
    assert mean["what"] == "maintained mean" and mean["unit"] == "lx" and mean["limit"] == "least"
    assert mean["required"] == 240 and mean["value"] == pytest.approx(250, rel=1e-3)
    assert [mean["verdict"], glare["verdict"]] == ["met", "met"]


def test_daylight_of_a_year_in_the_open(tmp_path: Path) -> None:
    weather = tmp_path / "day.epw"
    header = ["LOCATION,Munich,BY,DEU,x,0,48.1,11.7,1.0,520.0"] + [f"LINE {line}" for line in range(2, 9)]
    hours = [
        f"2001,6,21,{hour},60,A,20,10,40,95000,0,0,300,0,{(600, 0)[not 6 < hour < 20]},{(120, 0)[not 6 < hour < 20]}"
        for hour in range(1, 25)
    ]
    weather.write_text("\n".join(header + hours) + "\n")
    plane = {"name": "plane", "corner": (-0.5, 0, -0.5), "edges": ((1, 0, 0), (0, 0, 1)), "normal": (0, 1, 0)}
    meters = [plane | {"columns": 3, "rows": 2}]
    scene = floor(environment={"radiance": 1})
    year = bdpm.daylight(scene, weather, meters=meters, paths=2000, accel="bvh")
    (own,) = year.meters
    assert (year.occupied_hours, own.name) == (10, "plane") and year.paths >= 2000
    assert own.autonomy.shape == (2, 3) and own.useful.shape == (2, 3, 4) and own.by_month.shape == (12, 24)
    np.testing.assert_allclose(own.autonomy, 100)
    np.testing.assert_allclose(own.useful.sum(axis=2), 100)
    assert own.spatial_autonomy[0] == 100 and own.sunlight_exposure == 0
    mean, expanded = own.mean
    assert abs(own.illuminance.mean() - mean) < 1e-6 * mean and 0 < expanded < 0.05 * mean
    assert own.by_month[5, 1] == 0 and own.by_month[5, 12] > 30_000
    again = bdpm.daylight(scene, weather, meters=meters, paths=2000, accel="bvh", threads=1)
    np.testing.assert_array_equal(own.illuminance, again.meters[0].illuminance)
    with pytest.raises(bdpm.Error, match="o'clock"):
        bdpm.daylight(scene, weather, meters=meters, paths=2000, occupied=(18, 8))


def test_meters_that_are_not_valid_name_the_table() -> None:
    with pytest.raises(bdpm.Error, match="neither a point nor a grid"):
        bdpm.measure(floor(environment={"radiance": 1}), meters=[{"name": "a"}])


def test_glare_of_an_even_image_has_its_illuminance() -> None:
    image = np.ones((200, 200, 3), np.float32)
    rating = bdpm.glare(image)
    assert rating["vertical_illuminance"] == pytest.approx(math.pi * LUMENS_PER_WATT, rel=0.01)
    assert rating["ugr"] is None and rating["expanded"] is None
    with pytest.raises(ValueError, match="projection"):
        bdpm.glare(image, projection="flat")


def test_glare_of_a_path_traced_result_has_uncertainties() -> None:
    scene = floor(environment={"radiance": 1})
    result = bdpm.render(scene, iterations=8, camera_paths=2, strategy="path", resolution=(48, 48), accel="bvh")
    rating = bdpm.glare(result)
    # The half space above the eye has the radiance 1.
    assert rating["vertical_illuminance"] == pytest.approx(math.pi * LUMENS_PER_WATT, rel=0.02)
    assert rating["expanded"]["vertical_illuminance"] >= 0
    with pytest.raises(ValueError, match="fisheye"):
        bdpm.glare(bdpm.render(bdpm.load("scenes/cornell-box"), iterations=2, resolution=(16, 16), accel="bvh"))


def test_glare_of_several_results_has_uncertainties_by_their_spread() -> None:
    # The eye looks at a gray floor, at whose edges the sky begins.
    mesh = bdpm.Mesh(
        [(-1, 0, -1), (-1, 0, 1), (1, 0, 1), (1, 0, -1)], [(0, 1, 2), (0, 2, 3)], material={"albedo": 0.5}
    )
    camera = {"type": "fisheye", "position": (0, 0.5, 0), "target": (0, -5, 0), "up": (0, 0, 1)}
    scene = bdpm.Scene.from_meshes([mesh], camera=camera, environment={"radiance": 1})
    options: dict[str, Any] = {"iterations": 2, "light_paths": 100, "resolution": (32, 32), "accel": "bvh"}
    results = [bdpm.render(scene, seed=seed, **options) for seed in (1, 2, 3)]
    assert bdpm.glare(results[0])["expanded"] is None
    rating = bdpm.glare(results)
    alone = [bdpm.glare(result)["vertical_illuminance"] for result in results]
    assert rating["vertical_illuminance"] == pytest.approx(np.mean(alone), rel=1e-5)
    # Student's quantile of 95 % for two degrees of freedom
    spread = 4.303 * np.std(alone, ddof=1) / math.sqrt(3)
    assert spread > 0
    assert rating["expanded"]["vertical_illuminance"] == pytest.approx(spread, rel=1e-3)
    with pytest.raises(ValueError, match="seed"):
        bdpm.glare([results[0], results[1], results[0]])
