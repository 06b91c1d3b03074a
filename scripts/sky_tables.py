"""Writes the tables of crates/light/src/sky/hosek_wilkie.bin from those of the wheel mitsuba==3.9.1, see its LICENSE file.

    python3 scripts/sky_tables.py

The file has little-endian float32 numbers:

    parameters  [turbidity 1..10][albedo 0, 1][6 control points][R, G, B][9]
    radiance    [turbidity 1..10][albedo 0, 1][6 control points][R, G, B]
    sun         [turbidity 1..10][elevation 2, 5, .. 89 degrees][R, G, B]: normal irradiance, W/m^2
"""

from pathlib import Path

import mitsuba as mi
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(mi.__file__).parent / "data/sunsky"

# Offset and shape of a field, as `print(mi.TensorFile(name))` shows them for version 3.9.1.
RADIANCE = ("sunsky_datasets.bin", 418555, (10, 2, 6, 3), np.float64)
PARAMETERS = ("sunsky_datasets.bin", 421435, (10, 2, 6, 3, 9), np.float64)
SUN = ("sampling_data.bin", 168, (10, 30, 11), np.float32)
WAVELENGTHS = range(320, 721, 40)
# include/mitsuba/render/sunsky.h and core/spectrum.h
SPECTRUM_TO_RGB, CIE_Y_SUM = 467.069280386, 106.7502593994140625


def field(name, offset, shape, kind):
    count = int(np.prod(shape))
    return np.frombuffer((DATA / name).read_bytes(), kind, count, offset).reshape(shape).astype(np.float64)


def main():
    assert mi.__version__ == "3.9.1", "the offsets are those of version 3.9.1"
    mi.set_variant("scalar_rgb")
    matching = np.array([np.array(mi.linear_rgb_rec(float(one))) for one in WAVELENGTHS])
    sun = field(*SUN) @ matching / len(WAVELENGTHS) * SPECTRUM_TO_RGB / CIE_Y_SUM
    radiance = field(*RADIANCE) / CIE_Y_SUM
    numbers = np.concatenate([part.ravel() for part in (field(*PARAMETERS), radiance, sun)])
    target = ROOT / "crates/light/src/sky/hosek_wilkie.bin"
    target.write_bytes(numbers.astype("<f4").tobytes())
    print(f"{target}: {numbers.size} numbers")


if __name__ == "__main__":
    main()
