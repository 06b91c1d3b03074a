#!/usr/bin/env bash
# The tests of the Embree bindings and of the safe layer under valgrind: no access outside of what
# was allocated, no use of undefined values. Arguments go to the tests, as a filter for example.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if ! command -v valgrind >/dev/null; then
    echo "valgrind is not installed (Debian: apt-get install valgrind)" >&2
    exit 1
fi

# valgrind knows no AVX-512, so Embree gets a lesser instruction set, and one thread: valgrind runs
# one at a time anyway.
export BDPM_TEST_EMBREE="isa=avx2,threads=1"

run() { # package, test
    local binary
    binary=$(cargo test --locked --package "$1" --test "$2" --no-run --message-format=json \
        2>/dev/null | sed -n 's/.*"executable":"\([^"]*\)".*/\1/p' | tail -n 1)
    shift 2
    echo "valgrind $binary"
    valgrind --quiet --suppressions=scripts/valgrind.supp --error-exitcode=1 --leak-check=full --show-leak-kinds=definite \
        --errors-for-leak-kinds=definite "$binary" --test-threads=1 "$@"
}

run embree4-sys trace "$@"
run bdpm-accel accel "${@:-embree::}"
