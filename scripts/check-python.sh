#!/usr/bin/env bash
# Checks the Python package in the development build: lints, types, stubs and tests.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cargo=${CARGO:-cargo}
target=${CARGO_TARGET_DIR:-$root/target}

# shellcheck source=scripts/python-venv.sh
. "$root/scripts/python-venv.sh"
python_venv check numpy pytest==9.2.0 mypy==2.4.1 typing_extensions

cd "$root"
# All packages with a test of bdpm: dependencies have the features of `make test`, so that nothing is compiled again.
packages=(--locked --workspace --lib --bins --test memory)
"$cargo" clippy "${packages[@]}" -- -D warnings
"$cargo" build "${packages[@]}"

# The package as Python sees it: sources by links, the extension and the program as they were just built.
package=$target/python/bdpm
rm -rf "$package"
mkdir -p "$package/bin"
ln -s "$root"/python/bdpm/*.py "$root"/python/bdpm/*.pyi "$root"/python/bdpm/py.typed "$package/"
ln -s "$target/debug/libbdpm_python.so" "$package/_bdpm.abi3.so"
ln -s "$target/debug/bdpm" "$package/bin/bdpm"
# The interpreter is not near the libraries of the checkout.
[ -n "${EMBREE_DIR:-}" ] || [ ! -e "$root/.embree" ] || export EMBREE_DIR=$root/.embree
[ -n "${OIDN_DIR:-}" ] || [ ! -e "$root/.oidn" ] || export OIDN_DIR=$root/.oidn
export PYTHONPATH=$target/python PYTHONDONTWRITEBYTECODE=1 BDPM=$target/debug/bdpm

# mypy finds the sources by themselves, and the tests find the package.
"$python" -m mypy --config-file python/pyproject.toml python/bdpm python/tests
"$python" -m mypy.stubtest --concise --mypy-config-file python/pyproject.toml bdpm
"$python" -m pytest --quiet -p no:cacheprovider --rootdir python python/tests
