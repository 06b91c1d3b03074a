"""Judgments of images. A millisecond suffices for the minimum of eight steps, so that results do not depend on time."""

from pathlib import Path
from typing import Any

import bdpm
import numpy as np
import pytest
from numpy.typing import NDArray

SIZE = (64, 48)


def traced(scene: bdpm.Scene, seed: int) -> NDArray[np.float32]:
    return bdpm.render(
        scene, strategy="path", iterations=32, light_paths=2, camera_paths=4, resolution=SIZE, seed=seed
    ).image


def judged(scene: bdpm.Scene, image: Any, **more: Any) -> bdpm.Judgment:
    options: dict[str, Any] = {"time": "1ms", "seed": 3, **more}
    return bdpm.judge(image, scene, **options)


@pytest.fixture(scope="module")
def classic() -> bdpm.Scene:
    return bdpm.load(Path(__file__).resolve().parents[2] / "scenes/cornell-box-classic")


@pytest.fixture(scope="module")
def pair(classic: bdpm.Scene) -> list[NDArray[np.float32]]:
    return [traced(classic, seed) for seed in (1, 2)]


def test_right_pair_agrees_with_the_estimate(classic: bdpm.Scene, pair: list[NDArray[np.float32]]) -> None:
    judgment = judged(classic, pair[0], second=pair[1])
    assert judgment.verdict != "wrong" and judgment.risk == 0.05, str(judgment)
    assert judgment.mean_ratio is not None and judgment.mean_ratio.error is not None
    assert abs(judgment.mean_ratio.value - 1) < 5 * judgment.mean_ratio.error, str(judgment)
    assert judgment.noise_source == "two-images" and not judgment.lacks_point_lights
    assert judgment.factor is None and judgment.shift is None and judgment.regions == []
    rows, columns = judgment.map.shape
    assert judgment.map.dtype == np.float32 and columns > rows, "the image is wide"
    assert columns * judgment.map_side <= SIZE[0] < (columns + 1) * judgment.map_side
    assert np.abs(judgment.map).max() < judgment.map_threshold
    assert judgment.map_side in judgment.scales and judgment.paths > 0 and judgment.seconds > 0
    for square in judgment.scales.values():
        assert square.error is not None and abs(square.value) < 6 * square.error
    assert str(judgment).startswith(judgment.verdict) and judgment.verdict in repr(judgment)


def test_brighter_image_is_wrong_by_its_factor(classic: bdpm.Scene, pair: list[NDArray[np.float32]]) -> None:
    # Of another type of number, and not contiguous.
    brighter = [np.asfortranarray(1.5 * image.astype(np.float64)) for image in pair]
    judgment = judged(classic, brighter[0], second=brighter[1])
    assert judgment.verdict == "wrong", str(judgment)
    assert judgment.factor == pytest.approx(1.5, rel=0.1)


def test_darker_part_is_shown_by_the_map(classic: bdpm.Scene, pair: list[NDArray[np.float32]]) -> None:
    changed = [image.copy() for image in pair]
    for image in changed:
        image[24:, :32] *= 0.3
    judgment = judged(classic, changed[0], second=changed[1])
    assert judgment.verdict == "wrong" and judgment.factor is None, str(judgment)
    rows, columns = judgment.map.shape
    row, column = divmod(int(judgment.map.argmin()), columns)
    assert row >= rows // 2 and column < columns // 2, "below the middle, and left of it"
    assert judgment.map.min() < -judgment.map_threshold
    assert judgment.regions and judgment.regions[0]["objects"]


def test_one_image_has_the_noise_of_neighbors(classic: bdpm.Scene, pair: list[NDArray[np.float32]]) -> None:
    judgment = judged(classic, pair[0])
    assert judgment.noise_source == "neighbors" and judgment.mean_ratio is not None
    again = judged(classic, pair[0], threads=1)
    np.testing.assert_array_equal(judgment.map, again.map)
    assert not np.array_equal(judgment.map, judged(classic, pair[0], seed=4).map)


def test_images_that_cannot_be_judged_are_refused(classic: bdpm.Scene, pair: list[NDArray[np.float32]]) -> None:
    with pytest.raises(ValueError, match="image: expected an array of shape"):
        judged(classic, pair[0][..., 0])
    with pytest.raises(ValueError, match=r"the shape \(48, 64, 2\)"):
        judged(classic, pair[0][..., :2])
    with pytest.raises(ValueError, match="second has 32x48 pixels, and image 64x48"):
        judged(classic, pair[0], second=pair[1][:, :32])
    with pytest.raises(ValueError, match="resolution without crop"):
        judged(classic, pair[0], resolution=SIZE)
    with pytest.raises(ValueError, match="precision"):
        judged(classic, pair[0], precision=0.0)
    with pytest.raises(bdpm.Error, match="another seed"):
        judged(classic, pair[0], second=pair[0])
    with pytest.raises(bdpm.Error, match="too small"):
        judged(classic, pair[0][:4, :4])


def test_window_of_an_image_is_judged_with_its_crop(classic: bdpm.Scene, pair: list[NDArray[np.float32]]) -> None:
    crop = [image[8:, 16:48] for image in pair]
    right = judged(classic, crop[0], second=crop[1], resolution=SIZE, crop=(16, 8, 32, 40))
    assert right.verdict != "wrong", str(right)
    whole = judged(classic, crop[0], second=crop[1])
    scores = [square.value / square.error for square in whole.scales.values() if square.error]
    assert max(scores) > 10, "it is no whole image"
