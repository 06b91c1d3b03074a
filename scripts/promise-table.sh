#!/usr/bin/env bash
# Prints the table of promises in docs/optimum.md: the RMS that a render with automatic counts
# promised early, the RMS that it reports at the end, and the one against an independent longer
# render; and the time expected half way against the time it took.
#
#   scripts/promise-table.sh [SIDE [SECONDS]]    128 pixels, 20 s by default
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
side=${1:-128}
seconds=${2:-20}
bdpm=${BDPM:-${CARGO_TARGET_DIR:-target}/release/bdpm}
folder=$(mktemp -d)
trap 'rm -r "$folder"' EXIT

# The first number after a pattern in a line of JSON.
number() {
    grep -oE "$1[0-9.e+-]+" <<< "$2" | head -n 1 | grep -oE '[0-9.e+-]+$'
}

echo "| scene | ends by | promised / found | reported / found | expected half way / took |"
echo "|---|---|---|---|---|"
for scene in cornell-box cornell-box-classic keyhole; do
    common=(scenes/$scene --resolution "${side}x$side" --quiet --json)
    reference=$("$bdpm" render "${common[@]}" --time "$((4 * seconds))s" --seed 1000 \
        --output "$folder/reference.exr")
    reference_rms=$(number '"rms":' "$reference")
    # The target is what the time led to, so that both take about as long.
    target=
    for goal in time target; do
        case $goal in
            time) stop=(--time "${seconds}s") ;;
            target) stop=(--target-rms "$target") ;;
        esac
        result=$("$bdpm" render "${common[@]}" "${stop[@]}" --seed 1 --output "$folder/a.exr")
        target=$(number '"rms":' "$result")
        rmse=$("$bdpm" compare "$folder/a.exr" "$folder/reference.exr" --json)
        promised=$(number '"promise":\{"rms":' "$result")
        halfway=$(number '"half_way":\{"said_after":[0-9.e+-]+,"seconds":' "$result")
        took=$(number '"took":' "$result")
        echo "$scene $goal $(number '"rmse":' "$rmse") $reference_rms $promised $target $halfway $took" |
            awk '{
                found = sqrt($3^2 - $4^2)
                printf "| %s | %s | %.3f | %.3f | %.3f |\n", $1, $2, $5 / found, $6 / found, $7 / $8
            }'
    done
done
