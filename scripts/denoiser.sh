#!/usr/bin/env bash
# Puts Intel Open Image Denoise 2, which `bdpm render` loads, into the git-ignored prefix .oidn: the official
# library with its TBB as a Python wheel carries it, the parts for processors alone. Does nothing, quickly, when it is
# there, or when OIDN_DIR names a folder that has it.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
prefix=$root/.oidn

# The pinned contents of the prefix. Changing any line makes the next run rebuild it.
wheel=pyoidn==2.5.1.0
wheel_sha256=32ad13368f8de1ef63001942ad05b02a00cd732d1206d97f352d3a3f606d823e
version=2.5.1
recipe="1 $wheel_sha256"

# shellcheck source=scripts/apt.sh
. "$root/scripts/apt.sh"

archive_hint="Download Intel's Open Image Denoise 2 release archive for your system, unpack it, and set OIDN_DIR to the \
folder that has lib in it."

if [ -n "${OIDN_DIR:-}" ]; then
    # A library in one of these folders is enough.
    [ -n "$(ls "$OIDN_DIR"/{lib,lib64,bin,.}/*OpenImageDenoise* 2>/dev/null)" ] ||
        die "OIDN_DIR is $OIDN_DIR, but it has no lib/libOpenImageDenoise.so.2"
    exit 0
fi
[ "$(cat "$prefix/recipe" 2>/dev/null)" != "$recipe" ] || [ ! -e "$prefix/lib/libOpenImageDenoise.so.2" ] || exit 0
[ "$(uname -sm)" = "Linux x86_64" ] || die "no package of Open Image Denoise for $(uname -sm) here. $archive_hint"

command -v python3 >/dev/null && python3 -m pip --version >/dev/null 2>&1 || apt_install python3-pip
# Built aside and renamed, so that an interrupted run leaves nothing that looks finished.
find "$root" -maxdepth 1 -name '.oidn.??????' -mmin +60 -exec rm -rf {} +
work=$(mktemp -d "$root/.oidn.XXXXXX")
trap 'rm -rf "$work"' EXIT
say "fetching the denoiser: Python wheel $wheel"
python3 -m pip download -q --disable-pip-version-check --no-deps --only-binary=:all: \
    --implementation py --python-version 3.11 --abi none --platform manylinux2014_x86_64 --dest "$work/wheel" "$wheel" ||
    die "the wheel cannot be fetched. $archive_hint"
file=$(echo "$work"/wheel/pyoidn-*.whl)
echo "$wheel_sha256  $file" | sha256sum --check --status ||
    die "the wheel's checksum is $(sha256sum "$file" | cut -d' ' -f1), expected $wheel_sha256"
python3 -m zipfile -e "$file" "$work/wheel"
from=$work/wheel/pyoidn/oidn/lib
mkdir -p "$work/prefix/lib" "$work/prefix/share"
cp "$from/libOpenImageDenoise.so.2" "$from/libOpenImageDenoise_core.so.$version" \
    "$from/libOpenImageDenoise_device_cpu.so.$version" "$from/libtbb.so.12" "$work/prefix/lib/"
cp "$work"/wheel/pyoidn-*.dist-info/licenses/LICENSE "$work/prefix/share/wheel-license"
chmod 755 "$work"/prefix/lib/*.so.* # the loader wants them executable on some file systems
echo "$recipe" >"$work/prefix/recipe"
rm -rf "$prefix"
mv "$work/prefix" "$prefix"
chmod 755 "$prefix"
say "Open Image Denoise $version is ready in $prefix"
