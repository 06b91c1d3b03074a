"""Bidirectional photon mapping that measures and predicts its own noise.

    import bdpm

    scene = bdpm.load("scenes/cornell-box")
    result = bdpm.render(scene, time=20)
    print(result.error)
    result.save("cornell-box.png")

Images are float32 arrays of shape (height, width, 3) with linear Rec. 709 radiance, W/(m^2 sr), the first row at the top.
Problems that the user can solve raise `bdpm.Error`, which has a file, a line and help.
"""

from bdpm._bdpm import (
    VERSION as __version__,
    BestCounts,
    Daylight,
    DaylightReadings,
    Estimate,
    Job,
    Judgment,
    Measurement,
    Mesh,
    MeterReadings,
    Noise,
    Plan,
    Prediction,
    Progress,
    Reading,
    RelativeError,
    RenderResult,
    Scene,
    Timings,
    calibrate,
    convert,
    daylight,
    glare,
    judge,
    load,
    measure,
    read_exr,
)
from bdpm._error import Error
from bdpm._render import analyze, render, start

__all__ = [
    "BestCounts",
    "Daylight",
    "DaylightReadings",
    "Error",
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
    "__version__",
    "analyze",
    "calibrate",
    "convert",
    "daylight",
    "glare",
    "judge",
    "load",
    "measure",
    "read_exr",
    "render",
    "start",
]
