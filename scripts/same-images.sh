#!/usr/bin/env bash
# Renders all scenes with all strategies by two programs at fixed counts, and checks that the images are equal.
#
# usage: scripts/same-images.sh OLD_BDPM NEW_BDPM [SCENE...]
#
# A difference is printed with the RMSE of the two images; the exit status is then 1. What both programs refuse is left
# out. Set RESOLUTION (64x48), ITERATIONS (4) or LIGHT_PATHS (20000) for other images.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
old=$1 new=$2
shift 2
[ $# -gt 0 ] || set -- $(cd scenes && ls -d */scene.toml | xargs dirname)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

variants=(
  "--merge-vertex 1"
  "--merge-vertex 2"
  "--merge-vertex 2 --strategy mis"
  "--merge-vertex 1 --direct photon-map"
  "--merge-vertex 2 --kernel disc"
  "--merge-vertex 2 --strategy mis --kernel disc --accel bvh"
  "--merge-vertex 2 --bias reduce --layers none"
  "--merge-vertex 2 --strategy mis --guide 8"
  "--strategy path"
  "--strategy gather"
)
counts="--resolution ${RESOLUTION:-64x48} --iterations ${ITERATIONS:-4} --light-paths ${LIGHT_PATHS:-20000}"
equal=0 different=0
for scene; do
  for variant in "${variants[@]}"; do
    for program in old new; do
      # Options are words, not one argument.
      # shellcheck disable=SC2086
      "${!program}" render "scenes/$scene" $counts --camera-paths 3 $variant --quiet --output "$folder/$program.exr" \
        2>"$folder/$program.log" || echo refused >"$folder/$program.exr"
    done
    if cmp --silent "$folder/old.log" "$folder/new.log" && grep -q refused "$folder/old.exr"; then
      continue
    fi
    compared=$("$new" compare "$folder/old.exr" "$folder/new.exr")
    if grep -q "the images are equal" <<<"$compared"; then
      equal=$((equal + 1))
    else
      different=$((different + 1))
      echo "$scene $variant: $(grep -E '^(mean ratio|RMSE|maximum)' <<<"$compared" | tr -s ' ' | paste -sd,)"
    fi
  done
done
echo "$equal images equal, $different different"
[ "$different" = 0 ]
