#!/usr/bin/env bash
# Holds the Blender add-on against Cycles, in Blender as a Python module, which comes from PyPI (500 MB) into a virtual
# environment below `target`.
#
#   scripts/blender-check.sh              bad cases, then all lights, cameras, worlds and materials
#   scripts/blender-check.sh bad          bad cases only
#   scripts/blender-check.sh NAME...      only the elements of these names
#
#   BDPM=program   takes this program (default: target/release/bdpm, which is built if it is missing)
#   BLENDER_VENV   the environment (default: target/blender)
#   BPY=5.0.1      the version of Blender; needs the Python that it is made for, 3.11
#   PYTHON         that Python (default: python3.11, else python3)
#   BLENDER        runs in this Blender instead, such as Debian's `blender`
#   THREADS=n      of both programs (default: all processors)
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=${BLENDER_VENV:-$root/target/blender}
wheels=("bpy==${BPY:-5.0.1}" numpy)

skip() {
    echo "blender-check: skipped: $*" >&2
    exit 0
}

if [ -z "${BDPM:-}" ]; then
    BDPM=${CARGO_TARGET_DIR:-$root/target}/release/bdpm
    [ -x "$BDPM" ] || cargo build --manifest-path "$root/Cargo.toml" --locked --release --bin bdpm
fi
export BDPM
if [ -n "${BLENDER:-}" ]; then
    exec "$BLENDER" --background --factory-startup --python-exit-code 1 --python "$root/scripts/blender_check.py" -- "$@"
fi
if ! "$venv/bin/python" -c 'import bpy, numpy' 2>/dev/null; then
    python=${PYTHON:-$(command -v python3.11 || command -v python3 || true)}
    [ -n "$python" ] || skip "there is no Python"
    "$python" -m venv "$venv" 2>/dev/null || skip "Python has no venv (Debian: apt install python3-venv)"
    "$venv/bin/pip" install --quiet --disable-pip-version-check "${wheels[@]}" ||
        skip "there is no wheel of ${wheels[0]} for this Python, or no network"
fi
exec "$venv/bin/python" "$root/scripts/blender_check.py" "$@"
