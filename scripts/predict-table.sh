#!/usr/bin/env bash
# Prints the table of docs/measurements/predictions.md: pooled RMS predicted from a measurement at poor counts, against
# the sampled RMS of independent runs at far ones.
#
#   scripts/predict-table.sh [SIDE]    side of the images in pixels, 32 by default
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
side=${1:-32}
bdpm=${BDPM:-${CARGO_TARGET_DIR:-target}/release/bdpm}
folder=$(mktemp -d)
trap 'rm -r "$folder"' EXIT

# Value and standard error in the result of predict on stdin.
predicted() {
    sed -E 's/.*"pooled_rms":\{"value":([0-9.e-]+),"error":([0-9.e-]+)\},"mean_rms".*/\1 \2/'
}

# The same of the sampled variance, in the result of analyze.
sampled() {
    sed -E 's/.*"pooled_rms":\{"predicted":\{[^}]*\},"sampled":\{"value":([0-9.e-]+),"corrected":[0-9.e-]+,"error":([0-9.e-]+)\}.*/\1 \2/'
}

echo "| scene | \`--direct\` | k | N_F | N_B | predicted | sampled | ratio |"
echo "|---|---|---|---|---|---|---|---|"
for scene in cornell-box cornell-box-classic; do
    for direct in connect photon-map; do
        for k in 1 2; do
            common=(scenes/$scene --resolution "${side}x$side" --radius 2% --direct $direct
                --merge-vertex $k --quiet --json)
            "$bdpm" analyze "${common[@]}" --light-paths 300 --camera-paths 4 \
                --iterations 4096 --seed 1 --output "$folder/poor.exr" > /dev/null
            for far in "30000 4 2048" "300 100 1024" "3000 25 2048"; do
                read -r light camera iterations <<< "$far"
                predicted=$("$bdpm" predict "$folder/poor.exr" --light-paths "$light" \
                    --camera-paths "$camera" --json | predicted)
                found=$("$bdpm" analyze "${common[@]}" --light-paths "$light" \
                    --camera-paths "$camera" --iterations "$iterations" --seed 2 \
                    --output "$folder/far.exr" | sampled)
                echo "$scene $direct $k $light $camera $predicted $found" | awk '{
                    error = $6 / $8 * sqrt(($7 / $6)^2 + ($9 / $8)^2)
                    printf "| %s | %s | %s | %s | %s | %.4f +- %.4f | %.4f +- %.4f | ", \
                        $1, $2, $3, $4, $5, $6, $7, $8, $9
                    printf "%.4f +- %.4f |\n", $6 / $8, error
                }'
            done
        done
    done
done
