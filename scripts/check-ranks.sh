#!/usr/bin/env bash
# Renders by 1, 2, 3 and 5 processes, more than this machine may have processors, where there is MPI (`make mpi`).
# Only bdpm itself is built again for that, with little optimization.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if ! { command -v mpicc && command -v mpirun; } >/dev/null; then
    echo "check-ranks: skipped, there is no MPI; \`make mpi\` installs it" >&2
    exit 0
fi
"${CARGO:-cargo}" clippy --locked --package bdpm --features mpi --lib --bins --test ranks -- -D warnings
"${CARGO:-cargo}" test --locked --package bdpm --features mpi --test ranks \
    --config 'profile.test.package.bdpm.opt-level = 1'
