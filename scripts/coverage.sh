#!/usr/bin/env bash
# Prints the coverage of promised and reported intervals, and the regret of automatic choices, over scenes of this
# repository and others: the tables of docs/measurements/predictions.md and docs/measurements/regret.md.
#
#     scripts/coverage.sh intervals [SCENE...]     # 128 pixels, 3, 8 and 20 s, four seeds
#     scripts/coverage.sh regret [SCENE...]        # 128 pixels, 20 s
#
# A scene is a folder of scenes/ or any scene file. After `@path`, its reference is rendered by path tracing. Finished
# work is kept in target/measured, so that a stopped run continues. PIXELS, TIMES and SEEDS change the sizes.
set -euo pipefail
cd "$(dirname "$0")/.."

table=${1:?give intervals or regret}
shift
scenes=("$@")
if [ ${#scenes[@]} -eq 0 ]; then
    scenes=(cornell-box@path cornell-box-classic@path caustic-sphere@path daylight keyhole hall materials media
        objective office point-caustic prism smoke diamond-ring)
fi
case $table in
    intervals)
        cargo run --release --quiet --example error_intervals -- \
            "${PIXELS:-128}" "${TIMES:-3,8,20}" "${SEEDS:-4}" "${scenes[@]}"
        ;;
    regret)
        for scene in "${scenes[@]}"; do
            cargo run --release --quiet --example regret -- "$scene" "${PIXELS:-128}" "${TIMES:-20}" ||
                echo "| $scene | failed |"
        done
        ;;
    *)
        echo "error: \`$table\` is not a table; give intervals or regret" >&2
        exit 2
        ;;
esac
