"""Packs the Blender add-on: one file that is a legacy add-on (3.4 to 4.1) and an extension (4.2 and later).

    python3 scripts/blender_zip.py OUT.zip [PROGRAM]

With PROGRAM, the add-on contains that copy of bdpm, in its folder `bin`; Embree has to be where the copy finds it.
"""

import pathlib
import sys
import zipfile

SOURCE = pathlib.Path(__file__).parent.parent / "blender" / "bdpm_render"
# Equal sources give equal files.
DATE = (2000, 1, 1, 0, 0, 0)


def main(out, program=None):
    packed = [path for path in SOURCE.rglob("*") if path.suffix in {".py", ".toml"}]
    files = {path.relative_to(SOURCE.parent).as_posix(): path for path in packed}
    for name in ("LICENSE-APACHE", "LICENSE-MIT"):
        files[f"{SOURCE.name}/{name}"] = SOURCE.parent.parent / name
    if program:
        files[f"{SOURCE.name}/bin/{pathlib.Path(program).name}"] = pathlib.Path(program)
    pathlib.Path(out).parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, path in sorted(files.items()):
            entry = zipfile.ZipInfo(name, DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if "/bin/" in name else 0o644) << 16
            archive.writestr(entry, path.read_bytes())
    print(f"{out}: {len(files)} files")


main(*sys.argv[1:])
