#!/usr/bin/env bash
# What users do first, at the sizes they use, without options: every scene at 1920x1080 for 20 s, and for 3 s. Prints exit
# code, time over the given one, and the stated error. Look at every picture afterward.
#
# usage: smoke.sh PROGRAM FOLDER [SCENE:WIDTHxHEIGHT:SECONDS]...
#
# Without scenes: all of scenes/; 8 minutes on a machine that does nothing else. Exit code 1 if a render fails, states no
# error, or is late by over 5 % and half a second.
set -euo pipefail
program=$(realpath "$1")
mkdir -p "$2"
folder=$(realpath "$2")
shift 2
cd "$(dirname "${BASH_SOURCE[0]}")/.."
if [ $# = 0 ]; then
    for scene in scenes/*/scene.toml; do
        scene=$(dirname "$scene")
        set -- "$@" "$scene:1920x1080:20" "$scene:1920x1080:3"
    done
fi
bad=0
for each in "$@"; do
    IFS=: read -r scene size seconds <<<"$each"
    name=$(basename "$scene" .xml)
    [ "$name" != room ] || name=$(basename "$(dirname "$scene")")
    name="$name-$size-${seconds}s"
    begun=$(date +%s.%N) code=0
    "$program" render "$scene" --resolution "$size" --time "${seconds}s" --output "$folder/$name.exr" --json --quiet \
        >"$folder/$name.json" 2>"$folder/$name.log" || code=$?
    python3 - "$folder/$name" "$code" "$begun" "$(date +%s.%N)" "$seconds" <<'END' || bad=1
import json
import sys

name, code, begun, ended, seconds = sys.argv[1], *map(float, sys.argv[2:])
wall = ended - begun
report = json.load(open(f"{name}.json")) if code == 0 else {}
denoised = report.get("denoised") or {}
error = denoised.get("total_error") if denoised else (report.get("error") or {}).get("total")
is_late = wall > 1.05 * seconds + 0.5
stated = "no error" if error is None else f"{100 * error:.1f} %"
size = report.get("enlarged_from")
words = [stated, f"{report.get('iterations')} iterations", report.get("settings", {}).get("strategy", "")]
words += ["denoised"] * bool(denoised) + ["LATE"] * is_late
words += ["enlarged from {}x{}".format(*size)] if size else []
print(f"{name.rsplit('/', 1)[1]:36} exit code {code:.0f}  {wall:5.1f} s of {seconds:g}  {', '.join(words)}", flush=True)
sys.exit(code != 0 or error is None or is_late)
END
done
exit $bad
