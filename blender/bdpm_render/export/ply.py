"""Binary PLY files and arrays of places, as bdpm reads them."""

import numpy as np


def write(path, triangles, positions, normals=None, uvs=None, colors=None):
    """Writes a mesh: (n, 3) indices, and per vertex positions, unit normals, (u, v) and linear colors."""
    groups = [(("x", "y", "z"), positions)]
    if normals is not None:
        groups.append((("nx", "ny", "nz"), normals))
    if uvs is not None:
        groups.append((("u", "v"), uvs))
    if colors is not None:
        groups.append((("r", "g", "b"), colors))
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(positions)}"]
    header += [f"property float {name}" for names, _ in groups for name in names]
    header += [f"element face {len(triangles)}", "property list uchar uint vertex_indices", "end_header", ""]
    vertices = np.concatenate([values for _, values in groups], axis=1).astype("<f4", copy=False)
    faces = np.empty(len(triangles), np.dtype([("count", "u1"), ("corners", "<u4", 3)]))
    faces["count"] = 3
    faces["corners"] = triangles
    with open(path, "wb") as file:
        file.write("\n".join(header).encode())
        file.write(vertices.tobytes())
        file.write(faces.tobytes())


def write_places(path, matrices):
    """Writes (n, 3, 4) matrices."""
    np.save(path, np.ascontiguousarray(matrices, "<f8"))
