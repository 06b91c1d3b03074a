#!/usr/bin/env bash
# Installs MPI for `cargo build --features mpi`: Open MPI with its compiler wrapper and mpirun. Does nothing, quickly, when
# any MPI is there: MPICH's packages (libmpich-dev, mpich) or a cluster's own module do as well.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/apt.sh
. "$root/scripts/apt.sh"

command -v mpicc >/dev/null && command -v mpirun >/dev/null && exit 0
apt_install libopenmpi-dev openmpi-bin
