"""OpenEXR files as bdpm writes and reads them: one part of scan lines, 32-bit floats."""

import struct
import zlib

import numpy as np

MAGIC = b"\x76\x2f\x31\x01"
ZIP_LINES = {0: 1, 2: 1, 3: 16}  # scan lines of a chunk by compression: none, ZIPS, ZIP
FLOAT = 2


class ExrError(Exception):
    """The file is none that this reader knows."""


def read(path):
    """All channels as a dictionary from name to float32 array of shape (height, width), first row on top."""
    with open(path, "rb") as file:
        data = file.read()
    if data[:4] != MAGIC:
        raise ExrError(f"{path} is no EXR file")
    version = struct.unpack_from("<I", data, 4)[0]
    if version & 0xFFFFFBFF != 2:  # long names alone are allowed
        raise ExrError(f"{path} has tiles, parts or deep pixels")
    attributes, start = _attributes(data, 8)
    names = _channels(attributes["channels"])
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    compression = attributes["compression"][0]
    if compression not in ZIP_LINES:
        raise ExrError(f"{path} has a compression other than ZIP")
    lines = ZIP_LINES[compression]
    pixels = np.zeros((height, len(names), width), np.float32)
    for offset in np.frombuffer(data, "<u8", -(-height // lines), start):
        y, size = struct.unpack_from("<ii", data, int(offset))
        first, count = y - y0, min(lines, height - (y - y0))
        raw = data[int(offset) + 8 : int(offset) + 8 + size]
        full = count * len(names) * width * 4
        if compression and size < full:
            raw = _unpredicted(zlib.decompress(raw))
        if len(raw) != full:
            raise ExrError(f"{path} is cut short")
        pixels[first : first + count] = np.frombuffer(raw, "<f4").reshape(count, len(names), width)
    return {name: pixels[:, index] for index, name in enumerate(names)}


def write_rgb(path, rgb):
    """Writes float32 pixels of shape (height, width, 3), first row on top, without compression."""
    height, width, _ = rgb.shape
    channels = b"".join(name + b"\0" + struct.pack("<iiii", FLOAT, 0, 1, 1) for name in (b"B", b"G", b"R")) + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    header = MAGIC + struct.pack("<I", 2)
    for name, kind, value in (
        ("channels", "chlist", channels),
        ("compression", "compression", b"\0"),
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", b"\0"),
        ("pixelAspectRatio", "float", struct.pack("<f", 1)),
        ("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1)),
    ):
        header += name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value
    header += b"\0"
    line = np.dtype([("y", "<i4"), ("size", "<i4"), ("bgr", "<f4", (3, width))])
    lines = np.empty(height, line)
    lines["y"] = np.arange(height)
    lines["size"] = 12 * width
    lines["bgr"] = rgb[:, :, ::-1].transpose(0, 2, 1)
    offsets = len(header) + 8 * height + line.itemsize * np.arange(height, dtype="<u8")
    with open(path, "wb") as file:
        file.write(header)
        file.write(offsets.astype("<u8").tobytes())
        file.write(lines.tobytes())


def _attributes(data, at):
    found = {}
    while data[at]:
        name_end = data.index(0, at)
        kind_end = data.index(0, name_end + 1)
        size = struct.unpack_from("<i", data, kind_end + 1)[0]
        start = kind_end + 5
        found[data[at:name_end].decode()] = data[start : start + size]
        at = start + size
    return found, at + 1


def _channels(data):
    names, at = [], 0
    while data[at]:
        end = data.index(0, at)
        kind, _, x, y = struct.unpack_from("<4i", data, end + 1)
        if (kind, x, y) != (FLOAT, 1, 1):
            raise ExrError("a channel has no 32-bit floats")
        names.append(data[at:end].decode())
        at = end + 17
    return names


def _unpredicted(data):
    """Undoes what EXR does before it compresses: differences of bytes, and halves that take turns."""
    differences = np.frombuffer(data, np.uint8).astype(np.uint64)
    differences[1:] -= 128
    bytes_ = np.cumsum(differences).astype(np.uint8)
    half = (len(bytes_) + 1) // 2
    out = np.empty_like(bytes_)
    out[0::2], out[1::2] = bytes_[:half], bytes_[half:]
    return out.tobytes()
