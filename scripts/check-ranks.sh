#!/usr/bin/env bash
# Renders by 1, 2, 3 and 5 processes, more than this machine may have processors, where there is MPI (`make mpi`).
# Only the crates that use MPI are built again for that: the others have the features of `make test`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if ! { command -v mpicc && command -v mpirun; } >/dev/null; then
    echo "check-ranks: skipped, there is no MPI; \`make mpi\` installs it" >&2
    exit 0
fi
"${CARGO:-cargo}" clippy --locked --workspace --exclude bdpm-python --features bdpm/mpi \
    --bins --test ranks -- -D warnings
"${CARGO:-cargo}" test --locked --workspace --exclude bdpm-python --features bdpm/mpi --test ranks
