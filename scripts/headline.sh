#!/usr/bin/env bash
# Measures the tables that the README quotes, at one commit, one step after another. Finished steps are kept, so that a
# stopped run continues. Run it on a machine that does nothing else.
#
#   scripts/headline.sh list           steps, their minutes on two cores, and their pages in docs/measurements
#   scripts/headline.sh                all steps whose inputs are there: about five hours
#   scripts/headline.sh STEP...        only these, such as `law` or `equal-time`
#
# The programs of the commit are built once, into target/headline/COMMIT. Beside them, NAME.txt has the date, the load
# before, and the output of a finished step. COMMIT=abc1234 continues with an earlier commit whose programs are there.
#
# MITSUBA_SCENES is a folder with Benedikt Bitterli's cornell-box, veach-bidir and veach-mis in Mitsuba's format.
# PUBLIC_SCENES has rooms that scripts/interior_scenes.py wrote, as ROOM/room.xml. MITSUBA_VENV, RADIANCE_VENV and
# BLENDER_VENV are environments with mitsuba==3.9.1 and OpenEXR; pyradiance==1.3.1; bpy==5.0.1; each with numpy.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

steps="equal-time     40  mitsuba-equal-time.md   MITSUBA_SCENES MITSUBA_VENV
interiors      60  interiors.md            PUBLIC_SCENES MITSUBA_VENV
paths          15  interiors.md            PUBLIC_SCENES MITSUBA_VENV
cycles         10  cycles.md               BLENDER_VENV
law            10  predictions.md
error-maps     11  predictions.md
point-caustic  15  predictions.md
intervals      60  predictions.md
meters         60  meter-intervals.md
radiance       25  radiance.md             RADIANCE_VENV
guides          4  guides.md
regret         60  regret.md"

if [ "${1:-}" = list ]; then
    echo "$steps"
    exit
fi

commit=${COMMIT:-$(git rev-parse --short HEAD)}
folder=target/headline/$commit
if [ ! -x "$folder/bdpm" ]; then
    if [ -n "$(git status --porcelain --untracked-files=no)" ]; then
        echo "headline: commit your changes first: the tables name the commit" >&2
        exit 1
    fi
    cargo build --locked --release --bin bdpm --example picture --example error_intervals --example regret
    mkdir -p "$folder/examples"
    cp target/release/examples/{picture,error_intervals,regret} "$folder/examples"
    cp target/release/bdpm "$folder"
fi
BDPM=$(realpath "$folder/bdpm") PICTURE=$(realpath "$folder/examples/picture")
# Finished parts of a step.
MEASURED=$(realpath "$folder")/measured
export BDPM PICTURE MEASURED

# Runs a command whose output is kept under a name, unless that is done.
#   once NAME COMMAND...
once() {
    local name=$1
    shift
    if [ -f "$folder/$name.txt" ]; then
        echo "headline: $name is done" >&2
        return
    fi
    echo "headline: $name" >&2
    {
        echo "# $(date -u +%F), commit $commit, $(nproc) cores, load before: $(cut -d' ' -f1 /proc/loadavg)"
        "$@"
    } >"$folder/$name.part" 2>"$folder/$name.err" &
    if wait $!; then
        mv "$folder/$name.part" "$folder/$name.txt"
    else
        echo "headline: $name failed; see $folder/$name.err" >&2
    fi
}

# The same beside at most one other such command, each on a core of its own. `wait` ends a step.
paired() {
    while [ "$(jobs -rp | wc -l)" -ge 2 ]; do
        wait -n || true
    done
    once "$@" &
}

# A scene of the table of equal times, at one size.
equal_time() { THREADS=1 SIZES=$2 scripts/mitsuba-check.sh "$1"; }

run() {
    local size scene room
    case $1 in
        equal-time)
            for size in 128 own; do
                for scene in cornell-box veach-mis veach-bidir; do
                    paired "$scene-$size" equal_time "$MITSUBA_SCENES/$scene/scene.xml" "$size"
                done
                for scene in caustic-sphere keyhole; do
                    paired "$scene-$size" equal_time "scenes/$scene/mitsuba.xml" "$size"
                done
            done
            ;;
        interiors)
            for room in "$PUBLIC_SCENES"/*/room.xml; do
                once "interiors-$(basename "$(dirname "$room")")" \
                    "$MITSUBA_VENV/bin/python" scripts/interiors.py --bdpm "$BDPM" --time 20 \
                    --threads 2 --runs 2 --width 320 --reference 400 "$room"
            done
            ;;
        paths)
            for room in "$PUBLIC_SCENES"/*/room.xml; do
                once "paths-$(basename "$(dirname "$room")")" \
                    "$MITSUBA_VENV/bin/python" scripts/path_speed.py --bdpm "$BDPM" --rounds 2 \
                    --seconds 4 "$room"
            done
            ;;
        cycles)
            once cycles "$BLENDER_VENV/bin/python" scripts/blender_demo.py -- "$folder/demo.blend" --compare 30 \
                --reference 200 --threads 1 --picture "$folder/blender-caustics.jpg"
            ;;
        law) once law scripts/predict-table.sh ;;
        error-maps | point-caustic) once "$1" env OUT="$folder" scripts/pictures.sh "$1" ;;
        intervals) for_scenes intervals intervals ;;
        meters) once meters python3 scripts/meter_intervals.py coverage 200 1 ;;
        radiance) once radiance "$RADIANCE_VENV/bin/python" scripts/radiance_rooms.py ;;
        guides) once guides python3 scripts/guides_table.py ;;
        regret) for_scenes regret regret ;;
    esac
    wait
}

# Runs COMMAND... SCENE for the scenes of the tables, two at a time. References of rooms are path traced.
#   for_scenes STEP COMMAND...
for_scenes() {
    local step=$1 room scene
    local scenes=(cornell-box@path caustic-sphere keyhole materials office daylight point-caustic prism smoke hall)
    shift
    for room in "${PUBLIC_SCENES:-/none}"/*/room.xml; do
        [ ! -f "$room" ] || scenes+=("$room@path")
    done
    for scene in "${scenes[@]}"; do
        room=${scene%@path}
        # A room is named after its folder.
        paired "$step-$(basename "${room%/room.xml}")" "$@" "$scene"
    done
}

# Renders on one thread.
intervals() { RAYON_NUM_THREADS=1 "$folder/examples/error_intervals" 96 3,8,20 3 "$1"; }
regret() { RAYON_NUM_THREADS=1 "$folder/examples/regret" "$1" 128 20; }

if [ $# -eq 0 ]; then
    while read -r step _ _ inputs; do
        missing=
        for input in $inputs; do
            [ -n "${!input:-}" ] || missing="$missing $input"
        done
        if [ -n "$missing" ]; then
            echo "headline: $step is left out: set$missing" >&2
        else
            set -- "$@" "$step"
        fi
    done <<<"$steps"
fi
for step; do
    grep -q "^$step " <<<"$steps" || { echo "headline: there is no step $step; see \`headline.sh list\`" >&2; exit 2; }
    run "$step"
done
