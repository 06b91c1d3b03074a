#!/usr/bin/env bash
# Renders all scenes at common sizes for some times, and checks that every render ends without an error and in time.
# Prints a table with wall-clock time, peak memory, stated error and iterations.
#
# usage: scripts/sizes.sh [--sizes "WxH..."] [--times "SECONDS..."] [SCENE...]
#
# The default is all of scenes/ at 1280x720, 1920x1080 and 3840x2160 for 20 and 60 s: 52 minutes for 13 scenes. A render
# is late if it takes more than 5 % longer than its --time. The exit status is 1 if a render fails or is late. BDPM is
# the program [target/release/bdpm]. Nothing else should run on the machine.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bdpm=${BDPM:-${CARGO_TARGET_DIR:-target}/release/bdpm}
sizes="1280x720 1920x1080 3840x2160" times="20 60"
while [ $# -gt 0 ]; do
    case $1 in
        --sizes) sizes=${2:?"--sizes needs sizes, such as \"640x360 1280x720\""}; shift 2 ;;
        --times) times=${2:?"--times needs seconds, such as \"5 20\""}; shift 2 ;;
        -*) echo "unknown option $1; usage: scripts/sizes.sh [--sizes \"WxH...\"] [--times \"SECONDS...\"] [SCENE...]" >&2; exit 2 ;;
        *) break ;;
    esac
done
if [ $# -eq 0 ]; then
    for scene in scenes/*/scene.toml; do
        set -- "$@" "$(basename "$(dirname "$scene")")"
    done
fi
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

has_gnu_time() {
    /usr/bin/time -f '%e %M' -o "$folder/probe" true 2> /dev/null && grep -qE '^[0-9.]+ [0-9]+$' "$folder/probe"
}

# Runs a command. The last line of FILE becomes its wall-clock time in seconds and its peak memory in KiB.
#   measured FILE COMMAND...
if has_gnu_time; then
    measured() {
        /usr/bin/time -f '%e %M' -o "$@"
    }
else
    measured() {
        python3 -c '
import os, subprocess, sys, time
start = time.perf_counter()
process = subprocess.Popen(sys.argv[2:])
_, status, usage = os.wait4(process.pid, 0)
with open(sys.argv[1], "w") as file:
    print(f"{time.perf_counter() - start:.2f} {usage.ru_maxrss}", file=file)
sys.exit(os.WEXITSTATUS(status) if os.WIFEXITED(status) else 128 + os.WTERMSIG(status))
' "$@"
    }
fi

# Prints the row of a render. The exit status is 1 if the render failed or was late.
#   row SCENE SIZE SECONDS WALL KIB EXIT_CODE
row() {
    python3 - "$folder/result.json" "$@" << 'END'
import json, sys

path, scene, size, seconds, wall, kib, code = sys.argv[1:]
seconds, wall = float(seconds), float(wall)
try:
    with open(path) as file:
        result = json.load(file)
except ValueError:
    result = {}
error = (result.get("error") or {}).get("total")
error = "-" if error is None else f"{100 * error:.2f} %"
late = wall > 1.05 * seconds
verdict = "failed" if code != "0" or not result else "late" if late else "in time"
memory = f"{float(kib) / 1024:.0f} MiB"
cells = [scene, size, f"{seconds:g} s", f"{wall:.1f} s", f"{100 * (wall / seconds - 1):+.1f} %", memory, error]
print("|", " | ".join([*cells, str(result.get("iterations", "-")), code, verdict]), "|", flush=True)
sys.exit(verdict != "in time")
END
}

echo "| scene | size | time | wall-clock time | beyond the time | peak memory | stated error | iterations | exit code | verdict |"
echo "|---|---|---|---|---|---|---|---|---|---|"
failures=0
for scene; do
    for size in $sizes; do
        for seconds in $times; do
            code=0
            measured "$folder/measured" "$bdpm" render "scenes/$scene" --resolution "$size" --time "${seconds}s" \
                --json --quiet --output "$folder/image.exr" > "$folder/result.json" 2> "$folder/stderr" || code=$?
            read -r wall kib <<< "$(tail -n 1 "$folder/measured")"
            row "$scene" "$size" "$seconds" "$wall" "$kib" "$code" || failures=$((failures + 1))
            [ "$code" = 0 ] || sed 's/^/    /' "$folder/stderr" >&2
        done
    done
done
if [ "$failures" != 0 ]; then
    echo "$failures renders failed or were late" >&2
    exit 1
fi
