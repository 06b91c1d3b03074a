"""Scenes from files and from arrays."""

import json
import math
import subprocess
import warnings
from pathlib import Path
from typing import Any

import bdpm
import numpy as np
import pytest

SQUARE = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
HALVES = [(0, 1, 2), (0, 2, 3)]
CAMERA = {"position": (0, 0, 2), "target": (0, 0, 0), "fov_y_deg": 30}
BLACK_LAMP = {"albedo": 0, "emission": (3, 2, 1)}


def lamp(**more: Any) -> bdpm.Scene:
    return bdpm.Scene.from_meshes([bdpm.Mesh(SQUARE, HALVES, BLACK_LAMP)], camera=CAMERA, **more)


def test_lamp_that_fills_the_image_has_its_emission() -> None:
    image = bdpm.render(lamp(), iterations=1, light_paths=2, resolution=(8, 6)).image
    assert image.shape == (6, 8, 3)
    np.testing.assert_allclose(image.reshape(-1, 3), np.tile(np.array([3.0, 2.0, 1.0]), (48, 1)), rtol=1e-5)


def test_floor_under_a_point_light_has_the_analytic_radiance() -> None:
    floor = bdpm.Mesh(np.array(SQUARE, dtype=np.float64), np.array(HALVES, dtype=np.uint8), "chalk")
    scene = bdpm.Scene.from_meshes(
        [floor],
        camera=CAMERA | {"fov_y_deg": 0.01},
        lights=[{"type": "point", "position": np.array([0.75, 0, 1], dtype=np.float32), "intensity": 2.0}],
        materials={"chalk": {"albedo": np.float64(0.5)}},
    )
    # A plane reflects no light to itself, so that only direct light is left: albedo/pi I cos/d^2.
    expected = 0.5 / math.pi * 2.0 * 0.8 / 1.25**2
    image = bdpm.render(scene, iterations=4, strategy="path", resolution=(4, 4)).image
    np.testing.assert_allclose(image, expected, rtol=1e-3)


def test_settings_regions_and_names_are_those_given() -> None:
    scene = lamp(render={"resolution": (7, 5), "radius": "1%"}, regions={"left": [(0, 0, 0.5, 1)]}, name="sign")
    assert (scene.name, scene.triangles, scene.regions) == ("sign", 2, ["left"])
    assert scene.settings == {"resolution": [7, 5], "radius": "1%"}
    assert bdpm.render(scene, iterations=1, light_paths=2).image.shape == (5, 7, 3)


def test_scenes_of_arrays_have_skies_media_and_meters() -> None:
    uniform = {"model": "cie", "cie_type": 5, "diffuse_lx": 10000}
    above = {"name": "above", "position": (0, 5, 0), "normal": (0, 1, 0)}
    # +y is up: the lamp is below the meter, which sees the whole sky.
    scene = lamp(sky=uniform, meters=[above])
    reading = bdpm.measure(scene, target_error=0.02, threads=1).meters[0]
    assert reading.name == "above"
    np.testing.assert_allclose(reading.values, 10000, rtol=0.02)
    fog = {"thick": {"absorption": 0.7}}
    image = bdpm.render(lamp(media=fog, medium="thick"), iterations=1, light_paths=2, resolution=(8, 6)).image
    # The camera is two units away.
    np.testing.assert_allclose(image[3, 4], np.array([3.0, 2.0, 1.0]) * math.exp(-1.4), rtol=0.02)


def test_a_sky_replaces_the_environment_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "plate.obj").write_text("v -1 0 -1\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nf 1 2 3 4\n")
    uniform = {"model": "cie", "cie_type": 5, "diffuse_lx": 10000}
    scene = bdpm.load(tmp_path / "plate.obj", sky=uniform, look_at=((0, 3, 0.01), (0, 0, 0)))
    image = bdpm.render(scene, iterations=256, strategy="path", resolution=(4, 4)).image
    # The gray of files without materials, under the whole sky. Its four pixels have a noise of .4 %.
    expected = 0.5 / math.pi * 10000 / 683
    np.testing.assert_allclose(image[1:3, 1:3].mean(), expected, rtol=0.015)
    with pytest.raises(TypeError, match="not both"):
        bdpm.load(tmp_path / "plate.obj", sky=uniform, environment=1)


def test_unknown_key_names_file_line_and_help() -> None:
    with pytest.raises(bdpm.Error) as raised:
        bdpm.Scene.from_meshes([bdpm.Mesh(SQUARE, HALVES, {"albdo": 0.5})], camera=CAMERA, folder="scenes")
    error = raised.value
    assert error.problem == "unknown key `albdo`" and "`albedo`" in error.help
    assert error.file == str(Path("scenes/scene")) and error.line is not None
    assert str(error).startswith(f"scenes/scene:{error.line}: unknown key `albdo`")


def test_error_of_a_file_names_its_line(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text("[camera]\nposition = [0, 0, 1]\ntarget = 5\n")
    with pytest.raises(bdpm.Error) as raised:
        bdpm.load(path)
    assert (raised.value.file, raised.value.line) == (str(path), 3)
    with pytest.raises(bdpm.Error, match="cannot read the scene"):
        bdpm.load(tmp_path / "missing.toml")


@pytest.mark.parametrize(
    ("vertices", "triangles", "material", "expected"),
    [
        (SQUARE, [(0, 1, 4)], BLACK_LAMP, "triangle 0 uses vertex 4 of 4"),
        (SQUARE, HALVES, "chalk", "unknown material `chalk`"),
        (np.full((3, 3), np.nan), [(0, 1, 2)], BLACK_LAMP, "not finite"),
        (np.full((3, 3), 1e30), [(0, 1, 2)], BLACK_LAMP, "out of the range"),
        (SQUARE, np.zeros((0, 3), int), BLACK_LAMP, "no triangle"),
    ],
)
def test_bad_mesh_is_refused(vertices: Any, triangles: Any, material: Any, expected: str) -> None:
    with pytest.raises(bdpm.Error, match=expected):
        bdpm.Scene.from_meshes([bdpm.Mesh(vertices, triangles, material)], camera=CAMERA)


@pytest.mark.parametrize(
    ("arguments", "error", "expected"),
    [
        (([(0, 0)], HALVES, "a"), ValueError, "vertices: expected an array of shape"),
        ((SQUARE, [(0.5, 1, 2)], "a"), TypeError, "not integers"),
        ((SQUARE, [(0, 1, -2)], "a"), ValueError, "index -2"),
        ((SQUARE, HALVES, 7), TypeError, "neither the name"),
    ],
)
def test_bad_array_is_refused(arguments: Any, error: type[Exception], expected: str) -> None:
    with pytest.raises(error, match=expected):
        bdpm.Mesh(*arguments)


def test_scene_without_light_is_refused() -> None:
    with pytest.raises(bdpm.Error, match="no light"):
        bdpm.Scene.from_meshes([bdpm.Mesh(SQUARE, HALVES, {"albedo": 0.5})], camera=CAMERA)


def test_environment_replaces_that_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "square.obj"
    path.write_text("v -1 -1 0\nv 1 -1 0\nv 1 1 0\nf 1 2 3\n")
    scene = bdpm.load(path, environment=1.0)
    assert any("gray" in warning for warning in scene.warnings)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # A convex body in an environment of radiance 1 reflects its albedo.
        image = bdpm.render(scene, iterations=64, strategy="path", resolution=(16, 16), seed=2).image
    inside = image[7:9, 7:9].mean()
    assert abs(image.max() - 1) < 0.5 and 0.4 < inside <= 1.0


def test_camera_of_a_file_can_be_moved_and_taken_from_another() -> None:
    box = "scenes/cornell-box"
    same = [bdpm.load(box, look_at=((0, 1, 5), (0, 1, 0), (0, 1, 0)), fov=30) for _ in range(2)]
    images = [bdpm.render(scene, iterations=1, resolution=(8, 8), seed=3).image for scene in [*same, bdpm.load(box)]]
    np.testing.assert_array_equal(images[0], images[1])
    assert (images[0] != images[2]).any()
    assert bdpm.load(box, camera_from="scenes/keyhole").settings == bdpm.load(box).settings
    with pytest.raises(TypeError, match="look_at is not a position"):
        bdpm.load(box, look_at=((0, 1, 5),))
    with pytest.raises(bdpm.Error, match="field of view"):
        bdpm.load(box, fov=180)


def test_converted_arrays_are_the_same_scene(tmp_path: Path) -> None:
    scene = lamp(render={"resolution": (8, 6)}, name="sign")
    folder = tmp_path / "sign"
    converted = bdpm.convert(scene, folder)
    assert converted["folder"] == str(folder) and converted["files"] == sum(path.is_file() for path in folder.rglob("*"))
    first, again = converted["fingerprints"]
    assert first == again and converted["notes"] == []
    copy = bdpm.load(folder)
    assert copy.settings == scene.settings and copy.triangles == scene.triangles
    fixed: dict[str, Any] = {"iterations": 2, "light_paths": 50, "camera_paths": 1, "accel": "bvh"}
    np.testing.assert_array_equal(bdpm.render(copy, **fixed).image, bdpm.render(scene, **fixed).image)


def test_converted_file_is_that_of_the_program(tmp_path: Path, program: str) -> None:
    obj = "scenes/cornell-box/cornell-box.obj"
    own, other = tmp_path / "own", tmp_path / "other"
    converted = bdpm.convert(obj, own)
    done = subprocess.run([program, "convert", obj, other, "--json"], check=True, capture_output=True, text=True)
    assert {**json.loads(done.stdout), "folder": str(own)} == converted
    assert (own / "scene.toml").read_text() == (other / "scene.toml").read_text()
    assert any("no camera" in note["text"] for note in converted["notes"])
    with pytest.raises(bdpm.Error, match="scene.toml"):
        bdpm.convert(obj, own)
    assert bdpm.convert(obj, own, force=True)["fingerprints"] == converted["fingerprints"]
    with pytest.raises(TypeError, match="neither a Scene nor the path"):
        bdpm.convert(3, own)  # type: ignore[arg-type]
