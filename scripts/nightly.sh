#!/usr/bin/env bash
# Runs every check that is too long for each change, and prints what failed and how long each took. One that fails does
# not keep the others from running.
#
#     scripts/nightly.sh [TARGET...]     # targets of the Makefile; without any, all of them
#
# The output of each is in out/nightly/TARGET.log. TIMEOUT is the most seconds of one [default: 7200].
set -uo pipefail
cd "$(dirname "$0")/.."

targets=("$@")
if [ ${#targets[@]} -eq 0 ]; then
    targets=(check-long check-mitsuba check-notebooks check-package memcheck docs check-blender check-sizes)
fi
mkdir -p out/nightly
failed=0
printf '| %-16s | result | seconds |\n|---|---|---|\n' target
for target in "${targets[@]}"; do
    start=$SECONDS
    if timeout "${TIMEOUT:-7200}" make "$target" >"out/nightly/$target.log" 2>&1; then
        result=passed
    else
        result="failed: out/nightly/$target.log"
        failed=1
    fi
    printf '| %-16s | %s | %d |\n' "$target" "$result" $((SECONDS - start))
done
exit $failed
