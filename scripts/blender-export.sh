#!/bin/sh
# Exports a Blender scene as glTF and renders it:
#
#     scripts/blender-export.sh OUT.glb [SCENE.blend]
#
# Without SCENE.blend a small one is made, of a textured floor, balls of plastic, gold and chalk, and two lamps.
# Also writes OUT.exr and OUT.png, by bdpm, and OUT-cycles.exr, the same view by Blender's path tracer:
# `bdpm compare` tells how far apart they are. Takes Blender (Debian: `blender` and `python3-numpy`).
# BDPM is the program to run, BDPM_ARGS are more arguments for it.
set -eu

usage() { sed -n '2,10s/^# \{0,1\}//p' "$0" >&2; exit 2; }
[ $# -ge 1 ] && [ $# -le 2 ] || usage
case $1 in *.glb) out=${1%.glb} ;; *) usage ;; esac
command -v blender >/dev/null || { echo "there is no Blender; install blender and python3-numpy" >&2; exit 1; }
here=$(cd "$(dirname "$0")" && pwd)

# --background before the file: else Blender opens a window.
blender --background --factory-startup ${2:+"$2"} --python-exit-code 1 \
    --python "$here/blender_export.py" -- "$out" ${2:+given}

bdpm() {
    if [ -n "${BDPM:-}" ]; then "$BDPM" "$@"; else
        cargo run --release --quiet --manifest-path "$here/../Cargo.toml" -- "$@"
    fi
}
# shellcheck disable=SC2086 # several words
bdpm render "$out.glb" --output "$out.exr" ${BDPM_ARGS:---time 30s}
[ ! -e "$out-cycles.exr" ] || bdpm compare "$out.exr" "$out-cycles.exr"
