from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, TypedDict, final, type_check_only

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

__all__ = [
    "VERSION",
    "BestCounts",
    "Daylight",
    "DaylightReadings",
    "Estimate",
    "Job",
    "Judgment",
    "Measurement",
    "Mesh",
    "MeterReadings",
    "Noise",
    "Plan",
    "Prediction",
    "Progress",
    "Reading",
    "RelativeError",
    "RenderResult",
    "Scene",
    "Timings",
    "analyze",
    "calibrate",
    "convert",
    "daylight",
    "glare",
    "judge",
    "load",
    "measure",
    "read_exr",
    "start",
]

VERSION: str

@type_check_only
class Settings(TypedDict, total=False):
    resolution: tuple[int, int]
    crop: tuple[int, int, int, int]
    light_paths: int
    camera_paths: int
    radius: float | str
    caustic_radius: float | str
    medium_scale: float
    medium_share: float
    medium_query: Literal["points", "beams"]
    wavelength_width: float
    bias: Literal["keep", "reduce"]
    kernel: Literal["area", "disc"]
    merge_vertex: int
    strategy: Literal[
        "single", "mis", "cut-mis", "path", "path-caustics", "gather", "gather-caustics"
    ]
    guide: int
    sobol_set: int
    splitting: int
    light_visibility: int
    direct: Literal["connect", "photon-map"]
    seed: int

@type_check_only
class _JobOptions(Settings, total=False):
    threads: int | None
    accel: Literal["embree", "bvh"] | None

@type_check_only
class RenderOptions(_JobOptions, total=False):
    time: float | str | None
    target_error: float | None
    target_rms: float | str | None
    iterations: int | None
    objective: Literal["relative", "pooled", "mean-rms", "max-rms"]
    plan: Plan | None
    timings: Timings | None
    denoise: bool
    layers: Sequence[str] | None
    noise: bool

@type_check_only
class AnalyzeOptions(_JobOptions, total=False):
    iterations: int | None
    time: float | str | None
    estimator: Literal["pairs", "halves"]

@final
class Estimate:
    @property
    def value(self) -> float: ...
    @property
    def error(self) -> float | None: ...
    def __float__(self) -> float: ...

@final
class Progress:
    @property
    def iterations(self) -> int: ...
    @property
    def seconds(self) -> float: ...
    @property
    def seconds_left(self) -> float | None: ...
    @property
    def done(self) -> float: ...
    @property
    def error(self) -> float | None: ...
    @property
    def expected_error(self) -> float | None: ...
    @property
    def rms(self) -> float | None: ...

@final
class Mesh:
    def __new__(
        cls,
        vertices: ArrayLike,
        triangles: ArrayLike,
        material: str | Mapping[str, Any],
        *,
        normals: ArrayLike | None = None,
        uvs: ArrayLike | None = None,
        colors: ArrayLike | None = None,
        name: str = "mesh",
    ) -> Mesh: ...

@final
class Scene:
    @staticmethod
    def from_meshes(
        meshes: Sequence[Mesh],
        *,
        camera: dict[str, Any],
        lights: Sequence[dict[str, Any]] | None = None,
        environment: dict[str, Any] | None = None,
        sky: dict[str, Any] | None = None,
        materials: dict[str, Any] | None = None,
        media: dict[str, Any] | None = None,
        medium: str | None = None,
        meters: Sequence[dict[str, Any]] | None = None,
        regions: dict[str, Any] | None = None,
        render: dict[str, Any] | None = None,
        folder: str | PathLike[str] | None = None,
        name: str = "scene",
    ) -> Scene: ...
    @property
    def name(self) -> str: ...
    @property
    def origin(self) -> list[float]: ...
    @property
    def triangles(self) -> int: ...
    @property
    def regions(self) -> list[str]: ...
    @property
    def settings(self) -> dict[str, Any]: ...
    @property
    def warnings(self) -> list[str]: ...

@final
class Plan:
    @staticmethod
    def load(path: str | PathLike[str]) -> Plan: ...
    @property
    def iterations(self) -> int | None: ...
    @property
    def steps(self) -> list[tuple[int, float, int | None]]: ...

@final
class Timings:
    @staticmethod
    def load(path: str | PathLike[str]) -> Timings: ...
    def save(self, path: str | PathLike[str]) -> None: ...
    @property
    def fixed(self) -> float: ...
    @property
    def light_path(self) -> float: ...
    @property
    def camera_path(self) -> float: ...
    @property
    def look_up(self) -> float: ...
    @property
    def merge_pair(self) -> float: ...
    def iteration(self, *, light_paths: float, camera_paths: float) -> float: ...
    def parts(self, *, light_paths: float, camera_paths: float) -> tuple[float, float, float, float]: ...

@final
class Prediction:
    @property
    def light_paths(self) -> float: ...
    @property
    def camera_paths(self) -> float: ...
    @property
    def pooled_rms(self) -> Estimate: ...
    @property
    def mean_rms(self) -> Estimate: ...
    @property
    def iteration_time(self) -> float | None: ...
    @property
    def iterations(self) -> float | None: ...
    @property
    def pooled_rms_after(self) -> Estimate | None: ...
    @property
    def mean_rms_after(self) -> Estimate | None: ...

@final
class BestCounts:
    @property
    def light_paths(self) -> int: ...
    @property
    def camera_paths(self) -> int | NDArray[np.uint32]: ...
    @property
    def iteration_time(self) -> float: ...
    @property
    def rms(self) -> Estimate: ...
    @property
    def rms_after(self) -> Estimate | None: ...
    @property
    def time_to_target(self) -> Estimate | None: ...
    @property
    def rows(self) -> list[dict[str, Any]]: ...
    @property
    def plan(self) -> Plan: ...

@final
class Noise:
    @staticmethod
    def load(path: str | PathLike[str]) -> Noise: ...
    def save(self, path: str | PathLike[str]) -> None: ...
    @property
    def a(self) -> NDArray[np.float32]: ...
    @property
    def b(self) -> NDArray[np.float32]: ...
    @property
    def f(self) -> NDArray[np.float32]: ...
    @property
    def sampled_variance(self) -> NDArray[np.float32]: ...
    @property
    def luminance(self) -> NDArray[np.float32]: ...
    @property
    def image(self) -> NDArray[np.float32]: ...
    @property
    def light_paths(self) -> int: ...
    @property
    def camera_paths(self) -> int: ...
    @property
    def iterations(self) -> int: ...
    @property
    def regions(self) -> list[str]: ...
    def predict(
        self,
        *,
        light_paths: float,
        camera_paths: float,
        region: str | None = None,
        timings: Timings | None = None,
        time: float | str | None = None,
    ) -> Prediction: ...
    def optimize(
        self,
        timings: Timings,
        *,
        time: float | str | None = None,
        target_rms: float | str | None = None,
        objective: str = "relative",
        region: str | None = None,
        per_pixel: bool = False,
    ) -> BestCounts: ...

@final
class RelativeError:
    @property
    def total(self) -> float: ...
    @property
    def noise(self) -> float: ...
    @property
    def bias(self) -> float: ...
    @property
    def interval(self) -> tuple[float, float] | None: ...
    def __float__(self) -> float: ...

@final
class RenderResult:
    @property
    def image(self) -> NDArray[np.float32]: ...
    @property
    def layers(self) -> dict[str, NDArray[np.float32]]: ...
    @property
    def error(self) -> RelativeError | None: ...
    @property
    def rms(self) -> Estimate | None: ...
    @property
    def audit(self) -> dict[str, Any] | None: ...
    @property
    def promised_error(self) -> float | None: ...
    @property
    def noise(self) -> Noise | None: ...
    @property
    def plan(self) -> Plan: ...
    @property
    def settings(self) -> dict[str, Any]: ...
    @property
    def iterations(self) -> int: ...
    @property
    def seconds(self) -> float: ...
    @property
    def stopped_by(self) -> str: ...
    def to_png(self, *, tonemap: str = "srgb", exposure: float = 0.0) -> bytes: ...
    def save(self, path: str | PathLike[str], *, tonemap: str = "srgb", exposure: float = 0.0) -> None: ...
    def _repr_png_(self) -> bytes: ...

@final
class Reading:
    @property
    def value(self) -> float: ...
    @property
    def expanded(self) -> float: ...
    @property
    def noise(self) -> float: ...
    @property
    def bias(self) -> float: ...
    @property
    def direct(self) -> float: ...
    @property
    def indirect(self) -> float: ...
    def __float__(self) -> float: ...

@final
class MeterReadings:
    @property
    def name(self) -> str: ...
    @property
    def quantity(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def values(self) -> NDArray[np.float64]: ...
    @property
    def expanded(self) -> NDArray[np.float64]: ...
    @property
    def noise(self) -> NDArray[np.float64]: ...
    @property
    def bias(self) -> NDArray[np.float64]: ...
    @property
    def direct(self) -> NDArray[np.float64]: ...
    @property
    def indirect(self) -> NDArray[np.float64]: ...
    @property
    def positions(self) -> NDArray[np.float64]: ...
    @property
    def normals(self) -> NDArray[np.float64]: ...
    @property
    def mean(self) -> Reading: ...
    @property
    def minimum(self) -> tuple[float, float]: ...
    @property
    def maximum(self) -> tuple[float, float]: ...
    @property
    def uniformity(self) -> tuple[float, float]: ...
    @property
    def diversity(self) -> tuple[float, float]: ...
    @property
    def requirements(self) -> list[dict[str, Any]]: ...
    @property
    def by_light(self) -> dict[str, MeterReadings]: ...

@final
class Measurement:
    @property
    def meters(self) -> list[MeterReadings]: ...
    @property
    def reached(self) -> bool: ...
    @property
    def seconds(self) -> float: ...
    @property
    def techniques(self) -> list[str]: ...
    @property
    def notes(self) -> list[str]: ...

@final
class DaylightReadings:
    @property
    def name(self) -> str: ...
    @property
    def autonomy(self) -> NDArray[np.float64]: ...
    @property
    def autonomy_expanded(self) -> NDArray[np.float64]: ...
    @property
    def useful(self) -> NDArray[np.float64]: ...
    @property
    def useful_expanded(self) -> NDArray[np.float64]: ...
    @property
    def illuminance(self) -> NDArray[np.float64]: ...
    @property
    def illuminance_expanded(self) -> NDArray[np.float64]: ...
    @property
    def sun_hours(self) -> NDArray[np.float64]: ...
    @property
    def irradiation(self) -> NDArray[np.float64]: ...
    @property
    def irradiation_expanded(self) -> NDArray[np.float64]: ...
    @property
    def by_month(self) -> NDArray[np.float64]: ...
    @property
    def positions(self) -> NDArray[np.float64]: ...
    @property
    def spatial_autonomy(self) -> tuple[float, float]: ...
    @property
    def sunlight_exposure(self) -> float: ...
    @property
    def mean(self) -> tuple[float, float]: ...

@final
class Daylight:
    @property
    def place(self) -> str: ...
    @property
    def occupied_hours(self) -> int: ...
    @property
    def paths(self) -> int: ...
    @property
    def seconds(self) -> float: ...
    @property
    def meters(self) -> list[DaylightReadings]: ...

@final
class Judgment:
    @property
    def verdict(self) -> Literal["right", "wrong", "undecided"]: ...
    @property
    def risk(self) -> float: ...
    @property
    def mean_ratio(self) -> Estimate | None: ...
    @property
    def scales(self) -> dict[int, Estimate]: ...
    @property
    def map(self) -> NDArray[np.float32]: ...
    @property
    def map_side(self) -> int: ...
    @property
    def map_threshold(self) -> float: ...
    @property
    def agreement(self) -> float: ...
    @property
    def factor(self) -> float | None: ...
    @property
    def shift(self) -> tuple[float, float] | None: ...
    @property
    def regions(self) -> list[dict[str, Any]]: ...
    @property
    def noise_source(self) -> Literal["two-images", "neighbors"]: ...
    @property
    def lacks_point_lights(self) -> bool: ...
    @property
    def paths(self) -> float: ...
    @property
    def seconds(self) -> float: ...

@final
class Job:
    def result(self, progress: Callable[[Progress], object] | None = None) -> RenderResult: ...
    def stop(self) -> None: ...
    @property
    def done(self) -> bool: ...
    @property
    def progress(self) -> Progress: ...
    @property
    def image(self) -> NDArray[np.float32] | None: ...
    def _repr_png_(self) -> bytes | None: ...

def load(
    path: str | PathLike[str],
    *,
    camera: str | None = None,
    strict: bool = False,
    environment: str | float | PathLike[str] | None = None,
    sky: dict[str, Any] | None = None,
    fallback_light: bool = True,
    camera_from: str | PathLike[str] | None = None,
    look_at: Sequence[Sequence[float]] | None = None,
    fov: float | None = None,
    lights: Sequence[str] | None = None,
) -> Scene: ...
def convert(
    scene: Scene | str | PathLike[str], folder: str | PathLike[str], *, force: bool = False
) -> dict[str, Any]: ...
def start(scene: Scene, **options: Unpack[RenderOptions]) -> Job: ...
def analyze(
    scene: Scene,
    *,
    progress: Callable[[Progress], object] | None = None,
    **options: Unpack[AnalyzeOptions],
) -> Noise: ...
def calibrate(scene: Scene, *, time: float | str | None = None, **options: Unpack[_JobOptions]) -> Timings: ...
def measure(
    scene: Scene,
    *,
    meters: str | PathLike[str] | Sequence[Mapping[str, Any]] | None = None,
    time: float | str | None = None,
    target_error: float | None = None,
    mean: bool = False,
    by_light: bool = False,
    **options: Unpack[_JobOptions],
) -> Measurement: ...
def daylight(
    scene: Scene,
    weather: str | PathLike[str],
    *,
    meters: str | PathLike[str] | Sequence[Mapping[str, Any]] | None = None,
    time: float | str | None = None,
    paths: int | None = None,
    turn: float = 0.0,
    ground: float = 0.2,
    division: int = 2,
    autonomy: float = 300.0,
    occupied: tuple[float, float] = ...,
    seed: int = 0,
    threads: int | None = None,
    accel: Literal["embree", "bvh"] | None = None,
) -> Daylight: ...
def glare(
    image: RenderResult | list[RenderResult] | ArrayLike,
    *,
    projection: str = "equidistant",
    fov: float = 180.0,
    threshold: float = ...,
    peak: float = ...,
    search_angle: float = ...,
) -> dict[str, Any]: ...
def judge(
    image: ArrayLike,
    scene: Scene,
    *,
    second: ArrayLike | None = None,
    time: float | str | None = None,
    precision: float | None = None,
    seed: int | None = None,
    resolution: tuple[int, int] | None = None,
    crop: tuple[int, int, int, int] | None = None,
    threads: int | None = None,
    accel: Literal["embree", "bvh"] | None = None,
) -> Judgment: ...
def read_exr(path: str | PathLike[str]) -> dict[str, NDArray[np.float32]]: ...
