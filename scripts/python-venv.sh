# Sourced by scripts about the Python package: `python_venv NAME WHEEL...` makes the virtual environment
# target/venv-NAME with these wheels from PyPI, and sets `python` to its interpreter. Does nothing, quickly, if it is
# there with the same wheels.

# shellcheck source=scripts/apt.sh
. "$root/scripts/apt.sh"

python_venv() {
    local venv=${CARGO_TARGET_DIR:-$root/target}/venv-$1
    shift
    python=$venv/bin/python
    [ "$(cat "$venv/wheels" 2>/dev/null)" != "$*" ] || return 0
    python3 -c 'import ensurepip' 2>/dev/null || apt_install python3-venv
    rm -rf "$venv"
    python3 -m venv "$venv"
    say "fetching $*"
    "$python" -m pip install --quiet --disable-pip-version-check --only-binary=:all: "$@"
    echo "$*" >"$venv/wheels"
}
