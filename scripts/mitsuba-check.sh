#!/usr/bin/env bash
# Renders Mitsuba's scenes with both programs and tells how they agree, and which takes less time for the same
# error. Mitsuba comes from PyPI into a virtual environment below `target`.
#
#   scripts/mitsuba-check.sh SCENE.xml...     agreement, and the equal-time table
#   scripts/mitsuba-check.sh --elements       the small files of tests/data/mitsuba, each within its tolerance, or
#                                             only those named after it
#
#   BDPM=program   takes this program (default: target/release/bdpm, which is built if it is missing)
#   MITSUBA_VENV   the environment (default: target/mitsuba)
#   THREADS=n      of both programs (default: all processors)
#   SECONDS_EACH   of each image (default: 10, of elements 1.5), RUNS: images of each program (3, of elements 4)
#   SECONDS_REFERENCE  of the reference by each program (90)
#   ALSO           options of bdpm for one more row of the table
#   SIZES          pixels across and down, `own` for the file's own size (default: 128,own)
#
# Mitsuba's variant `llvm_ad_rgb`, which needs libLLVM 17 or newer, is taken if it runs, else `scalar_rgb`.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=${MITSUBA_VENV:-$root/target/mitsuba}
wheels=(mitsuba==3.9.1 numpy OpenEXR)

skip() {
    echo "mitsuba-check: skipped: $*" >&2
    exit 0
}

[ $# -gt 0 ] || { sed -n '2,18s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 2; }
if ! "$venv/bin/python" -c 'import mitsuba, numpy, OpenEXR' 2>/dev/null; then
    command -v python3 >/dev/null || skip "there is no Python"
    python3 -m venv "$venv" 2>/dev/null || skip "Python has no venv (Debian: apt install python3-venv)"
    "$venv/bin/pip" install --quiet --disable-pip-version-check "${wheels[@]}" ||
        skip "there is no wheel of ${wheels[0]} for this Python, or no network"
fi
if [ -z "${BDPM:-}" ]; then
    BDPM=${CARGO_TARGET_DIR:-$root/target}/release/bdpm
    [ -x "$BDPM" ] || cargo build --manifest-path "$root/Cargo.toml" --locked --release --bin bdpm
fi
BDPM=$BDPM exec "$venv/bin/python" "$root/scripts/mitsuba_check.py" "$@"
