#!/usr/bin/env bash
# Makes the pictures of scenes in docs/pictures, as JPEG files of at most 400 KB. CONTRIBUTING.md says where the other
# pictures of the documentation come from. Labels in the pictures have program, time and error. A line for each render
# on stdout has its commit, command, time and errors.
#
#   scripts/pictures.sh            all of them: about two hours on two cores; `classroom` and `room-mitsuba` with PUBLIC_SCENES
#   scripts/pictures.sh NAME...    only these; each takes at most 20 minutes
#
# Set SECONDS_EACH=5 for a quick trial: then no render takes longer than that. OUT=FOLDER writes to another
# folder. BDPM and PICTURE name programs that are built already. PUBLIC_SCENES is a folder of Benedikt Bitterli's scenes
# in Mitsuba's format. Denoised pictures want `make denoiser`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

repository=$PWD
out=${OUT:-docs/pictures}
work=${CARGO_TARGET_DIR:-target}/pictures
built=${CARGO_TARGET_DIR:-target}/release
bdpm=${BDPM:-$built/bdpm}
picture=${PICTURE:-$built/examples/picture}
mkdir -p "$out" "$work"
if [ -z "${BDPM:-}" ] || [ -z "${PICTURE:-}" ]; then
    cargo build --locked --release --bin bdpm --example picture
fi

# Some programs run in the folder of the pictures.
work=$(realpath "$work") out=$(realpath "$out") bdpm=$(realpath "$bdpm") picture=$(realpath "$picture")
commit=$(git describe --always --dirty --exclude '*' 2>/dev/null || echo unknown)

# The seconds of a render, at most those of a trial.
bounded() { echo $(($1 < ${SECONDS_EACH:-100000} ? $1 : SECONDS_EACH)); }

# Renders SCENE, a folder of scenes/ or a path, for SECONDS to $work/NAME.exr, with the result in $work/NAME.json.
#   render NAME SCENE SECONDS [OPTION...]
render() {
    local name=$1 scene=$2 seconds=$3
    shift 3
    case $scene in
        /*) ;;
        *) scene=scenes/$scene ;;
    esac
    seconds=$(bounded "$seconds")
    case " $* " in
        *" --denoise "*) ;;
        *) set -- "$@" --no-denoise ;;
    esac
    "$bdpm" render "$scene" --output "$work/$name.exr" --time "${seconds}s" --quiet --json "$@" >"$work/$name.json"
    echo "$name: commit $commit, bdpm render $(shown "$scene") --time ${seconds}s $*:" \
        "$("$picture" facts "$work/$name.json")"
}

# A scene as the documentation names it: public scenes by their path in their folder.
shown() {
    case $1 in
        "$work"/*) basename "$1" ;;
        /*) realpath --relative-to "$PUBLIC_SCENES" "$1" ;;
        *) echo "$1" ;;
    esac
}

# A picture of one scene with its time and error.
#   single NAME SCENE SECONDS [OPTION...]
single() {
    render "$@"
    "$picture" strip "$out/$1.jpg" "$work/$1.exr" "bdpm@$work/$1.json"
}

# A picture of one scene, denoised if that pays, with its time and error.
#   denoised NAME SCENE SECONDS [OPTION...]
denoised() {
    render "$@" --denoise
    "$picture" strip "$out/$1.jpg" "result@$work/$1.exr" "bdpm@$work/$1.json"
}

# The path of a file in the folder of public scenes.
public() {
    if [ ! -f "${PUBLIC_SCENES:-}/$1" ]; then
        echo "pictures: PUBLIC_SCENES has no $1: set it to a folder of public scenes in Mitsuba's format" >&2
        return 1
    fi
    realpath "$PUBLIC_SCENES/$1"
}

# Writes the scene of a how-to to $work, by the first block of commands of its page that makes FILE.
#   of_page PAGE [FILE]
of_page() {
    local block
    block=$(awk -v file="${2:-room.toml}" '
        /^```sh$/ { inside = 1; text = ""; next }
        /^```$/ { if (inside && index(text, "cat > " file)) { printf "%s", text; exit } inside = 0 }
        inside && !/^bdpm / { text = text $0 "\n" }' "$1")
    (cd "$work" && bash -euc "$block")
}

# A scene of the upper half of the sky over a field, by one of its models.
open_field() {
    cat <<'END'
[camera]
type = "fisheye"
projection = "equidistant"
fov_deg = 180
position = [0, 1, 0]
target = [0, 2, 0]
up = [0, 0, -1]

[[mesh]]
file = "field.obj"
END
    printf 'v -50 0 -50\nv -50 0 50\nv 50 0 50\nv 50 0 -50\nf 1 2 3 4\n' >"$work/field.obj"
    echo "[sky]"
    case $1 in
        cie) echo 'model = "cie"'; echo "cie_type = 1"; echo "diffuse_lx = 10000" ;;
        perez) echo 'model = "perez"'; echo "direct = 300"; echo "diffuse = 250" ;;
        *) echo 'model = "hosek-wilkie"' ;;
    esac
    [ "$1" = cie ] || printf 'latitude = 48.1\nlongitude = 11.6\ndate = [2026, 6, 21]\nhour = 16\ntimezone = 2\n'
}

# Relative RMSE of an image to a reference in percent.
difference() {
    "$bdpm" compare "$1" "$2" --json | sed -E 's/.*"relative_mse":([0-9.eE+-]+).*/\1/' |
        awk '{ printf "%.1f %%", 100 * sqrt($1) }'
}

# The renderer beside its own path tracer after equal time.
#   equal_time NAME SCENE SECONDS REFERENCE_SECONDS OPTION...
equal_time() {
    local name=$1 scene=$2 long=$4 seconds
    seconds=$(bounded "$3")
    shift 4
    render "$name-automatic" "$scene" "$seconds" "$@"
    render "$name-path" "$scene" "$seconds" --strategy path "$@"
    render "$name-reference" "$scene" "$long" --seed 2 "$@"
    "$picture" strip "$out/$name.jpg" \
        "$work/$name-automatic.exr" "bdpm, $seconds s: error $(difference "$work/$name-"{automatic,reference}.exr)" \
        "$work/$name-path.exr" "path tracing, $seconds s: error $(difference "$work/$name-"{path,reference}.exr)"
}

make_picture() {
    case $1 in
        # The hero: promised and measured error in its corner.
        point-caustic)
            render point-caustic point-caustic 900 --resolution 1600x1200
            "$picture" strip "$out/point-caustic.jpg" "$work/point-caustic.exr" "@$work/point-caustic.json"
            ;;
        # The furnished room of the README: a public scene (CC-BY 3.0, "Japanese Classroom" by NovaZeeke).
        classroom)
            local room
            room=$(public classroom/scene.xml)
            denoised classroom "$room" 300 --resolution 1280x720
            ;;
        hall) denoised hall hall 600 --resolution 1620x1080 ;;
        objective) denoised objective objective 600 --resolution 1620x1080 ;;
        daylight) denoised daylight daylight 600 --resolution 1920x1080 ;;
        materials) single materials materials 400 --resolution 1440x810 ;;
        caustic-sphere) single caustic-sphere caustic-sphere 300 --resolution 800x800 ;;
        smoke) denoised smoke smoke 200 --resolution 512x512 ;;
        prism) denoised prism prism 480 --resolution 1600x1200 --caustic-radius 0.01 ;;
        diamond-ring) denoised diamond-ring diamond-ring 300 --resolution 1600x1200 --strategy mis ;;
        cornell-box) single cornell-box cornell-box 60 --resolution 512x512 ;;
        # Equal time against path tracing; a path tracer cannot sample the lights of point-caustic at all.
        equal-time-caustic) equal_time equal-time-caustic caustic-sphere 30 300 --resolution 512x512 ;;
        equal-time-keyhole) equal_time equal-time-keyhole keyhole 30 300 --resolution 512x512 ;;
        equal-time-daylight) equal_time equal-time-daylight daylight 30 300 --resolution 640x360 ;;
        # Image, reported error and true error on one scale.
        error-maps)
            render error-maps caustic-sphere 20 --resolution 480x480
            render error-maps-reference caustic-sphere 600 --resolution 480x480 --seed 2
            "$picture" errors "$out/error-maps.jpg" "$work/error-maps.exr" "$work/error-maps-reference.exr" \
                "bdpm@$work/error-maps.json"
            # For the table in docs/measurements/predictions.md.
            echo "error-maps: true error $(difference "$work/error-maps"{,-reference}.exr)"
            ;;
        guides)
            render guides-without daylight 10 --resolution 320x320 --threads 1 --guide 0
            render guides-with daylight 10 --resolution 320x320 --threads 1
            "$picture" strip "$out/guides.jpg" "$work/guides-without.exr" "no guide@$work/guides-without.json" \
                "$work/guides-with.exr" "guide@$work/guides-with.json"
            ;;
        caustic-radii)
            local inputs=() radius
            for radius in .012 .006 .003; do
                render "radius$radius" point-caustic 20 --resolution 320x240 --strategy single --merge-vertex 1 \
                    --radius .012 --caustic-radius "$radius"
                inputs+=("$work/radius$radius.exr" "radius $radius@$work/radius$radius.json")
            done
            "$picture" strip "$out/caustic-radii.jpg" "${inputs[@]}"
            ;;
        denoising) # wants `make denoiser`
            render denoising caustic-sphere 8 --resolution 256x256 --threads 1 --denoise
            "$picture" strip "$out/denoising.jpg" "$work/denoising.exr" "raw@$work/denoising.json" \
                "denoised@$work/denoising.exr" "denoised@$work/denoising.json"
            ;;
        report) # wants Chromium, which is installed if it is missing
            render report caustic-sphere 60 --resolution 512x512 --report "$work/report.html"
            (
                root=$PWD
                # shellcheck source=scripts/apt.sh
                . scripts/apt.sh
                # shellcheck source=scripts/browser.sh
                . scripts/browser.sh
                run --window-size=1280,1600 "--screenshot=$work/report.png" "file://$(realpath "$work")/report.html" >/dev/null
            )
            "$picture" strip "$out/report.jpg" "$work/report.png" ""
            ;;
        office)
            # The room, and lux on the plane of its desks.
            render office office 60 --denoise --resolution 640x480
            (cd "$work" && "$bdpm" measure "$repository/scenes/office" --time "$(bounded 60)s" --quiet --maps maps >/dev/null)
            "$picture" strip "$out/office.jpg" "result@$work/office.exr" "bdpm@$work/office.json" \
                "$work/maps/working-plane.png" ""
            ;;
        sky)
            # What lies above an open field at 16:00 of a day in June: three models of the sky.
            local model inputs=()
            for model in hosek-wilkie perez cie; do
                open_field "$model" >"$work/sky-$model.toml"
                render "sky-$model" "$work/sky-$model.toml" 10 --denoise --resolution 400x400
                inputs+=("result@$work/sky-$model.exr" "$model@$work/sky-$model.json")
            done
            "$picture" strip "$out/sky.jpg" "${inputs[@]}"
            ;;
        glare)
            # The eye of the how-to about daylight, and what dazzles it.
            of_page docs/how-to/daylight.md
            render eye "$work/room.toml" 60 --resolution 600x600
            # Noise above the threshold would count as sources.
            "$bdpm" denoise "$work/eye.exr" --output "$work/eye-denoised.exr" >/dev/null
            "$bdpm" glare "$work/eye-denoised.exr" --picture "$work/eye-sources.png" >/dev/null
            "$picture" strip "$out/glare.jpg" "$work/eye.exr" "bdpm@$work/eye.json" "$work/eye-sources.png" ""
            ;;
        goniometer)
            # The downlight of the how-to about luminaires.
            of_page docs/how-to/luminaires.md downlight.toml
            (cd "$work" && "$bdpm" goniometer downlight.toml --time "$(bounded 20)s" --quiet --plot downlight.svg >/dev/null)
            cp "$work/downlight.svg" "$out/goniometer.svg"
            echo "goniometer: commit $commit, bdpm goniometer downlight.toml --time $(bounded 20)s"
            ;;
        drinks)
            local scene inputs=()
            for scene in wine milk fog; do
                render "drinks-$scene" "media/$scene.xml" 90 --denoise --resolution 400x400
                inputs+=("result@$work/drinks-$scene.exr" "$scene@$work/drinks-$scene.json")
            done
            "$picture" strip "$out/drinks.jpg" "${inputs[@]}"
            ;;
        room-mitsuba) # wants Mitsuba, PUBLIC_SCENES/living-room/room.xml and its reference by interiors.py --width 320
            local room row theirs ours seconds
            room=$(public living-room/room.xml)
            seconds=$(bounded 60)
            mkdir -p "$work/finished"
            row=$("${MITSUBA_VENV:-target/mitsuba}/bin/python" scripts/finished_pictures.py --bdpm "$bdpm" --width 640 \
                --times "$seconds" --keep "$work/finished" "$room" | tail -1)
            read -r theirs ours < <(awk -F '|' '{ printf "%.1f %.1f\n", 100 * $5, 100 * $6 }' <<<"$row")
            "$picture" strip "$out/room-mitsuba.jpg" \
                "result@$work/finished/living-room-640-$seconds-0.exr" "bdpm, $seconds s, denoised: error $ours %" \
                "$work/finished/living-room-640-$seconds-0-mitsuba.exr" "Mitsuba, $seconds s, denoised: error $theirs %"
            echo "room-mitsuba: commit $commit, finished_pictures.py: $row"
            ;;
        volume-caustics) # wants Mitsuba, which scripts/mitsuba-check.sh installs
            local scene name reference error inputs seconds
            seconds=$(bounded 30)
            "${MITSUBA_VENV:-target/mitsuba}/bin/python" scripts/media_table.py --images --bdpm "$bdpm" --size 320 \
                --seconds "$seconds" --folder "$work/media" smoke underwater
            for scene in smoke underwater; do
                reference=$scene-reference inputs=()
                render "$reference" "media/$scene.xml" 400 --resolution 320x320 --seed 2
                for name in bdpm volpath; do
                    error=$(difference "$work/media/$scene-$name.exr" "$work/$reference.exr")
                    inputs+=("$work/media/$scene-$name.exr" "$name, $seconds s: error $error")
                done
                "$picture" strip "$out/$scene-volpath.jpg" "${inputs[@]}"
            done
            ;;
        *) echo "pictures: there is no picture $1" >&2 && return 1 ;;
    esac
}

all=(point-caustic hall objective daylight materials caustic-sphere smoke prism diamond-ring cornell-box
    equal-time-caustic equal-time-keyhole equal-time-daylight error-maps guides caustic-radii denoising report
    volume-caustics office sky glare goniometer drinks)
# Their scenes are not in the repository.
[ -z "${PUBLIC_SCENES:-}" ] || all+=(classroom room-mitsuba)
[ $# -gt 0 ] || set -- "${all[@]}"
for name; do
    echo "pictures: $name" >&2
    make_picture "$name"
done
