#!/usr/bin/env bash
# Installs what building bdpm needs beyond Rust itself: a C compiler and libclang (for bindgen) and
# Intel Embree 4.3 or a newer 4. Does nothing, quickly, when all of it is there.
#
#   EMBREE_DIR=/prefix   use this Embree 4 (include/embree4 and lib below it); skips its set-up
#
# Debian 12 has no Embree 4 package. There this script makes a git-ignored prefix, .embree, from two
# published packages: Debian 13's headers and Intel's library as a Python wheel carries it.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
prefix=$root/.embree

# The pinned contents of the prefix. Changing any line makes the next run rebuild it.
headers_suite=trixie
headers_sha256=5359747908b7ec491ecb6a8fcf95d4aa84fb8d70a772e7bd5330b4545580befd # of the sorted list of header checksums
wheel=embreex==4.4.0.post1
wheel_sha256=2cd0f7d5c6342e6247e31f700761689cae7829454d8c6de0c41e62124a023e1f
recipe="1 $headers_sha256 $wheel_sha256"

# shellcheck source=scripts/apt.sh
. "$root/scripts/apt.sh"

# --- System packages -----------------------------------------------------------------------------

any_exists() {
    local file
    for file in "$@"; do
        [ ! -e "$file" ] || return 0
    done
    return 1
}

has_libclang() {
    [ -n "${LIBCLANG_PATH:-}" ] && return 0
    any_exists /usr/lib/llvm-*/lib/libclang{,-[0-9]*}.so* \
        /usr/lib{,64}/{,*-linux-gnu/}libclang{,-[0-9]*}.so* || return 1
    # Debian's libclang1-* alone, as Doxygen brings it, lacks the compiler's own headers.
    any_exists /usr/lib{,64}/{,llvm*/lib{,64}/}clang/*/include/stddef.h
}

# Before anything is installed for it.
check_rust() {
    local need=1.89 version
    command -v cargo >/dev/null ||
        die "cargo is not on the PATH; install Rust $need or newer with rustup first"
    version=$(cargo --version | cut -d' ' -f2)
    printf '%s\n' "$need" "$version" | sort -V -C ||
        die "this is Rust $version, but bdpm needs $need or newer; install it with rustup"
}

install_build_tools() {
    local missing=()
    command -v cc >/dev/null || missing+=(build-essential)
    has_libclang || missing+=(libclang-dev)
    [ ${#missing[@]} -eq 0 ] || apt_install "${missing[@]}"
}

# --- Embree --------------------------------------------------------------------------------------

archive_hint="Download Intel's Embree 4 release archive for your system, unpack it, and set EMBREE_DIR \
to the folder that has include/embree4 and lib in it; or build with --no-default-features, without \
Embree."

has_system_embree() {
    [ -e /usr/include/embree4/rtcore.h ] || [ -e /usr/local/include/embree4/rtcore.h ]
}

prefix_is_current() {
    [ "$(cat "$prefix/recipe" 2>/dev/null)" = "$recipe" ] && [ -e "$prefix/lib/libembree4.so" ] &&
        [ -e "$prefix/include/embree4/rtcore.h" ]
}

# The distribution's own Embree, if it is a 4 and not older than 4.3.
apt_has_embree4() {
    local version
    version=$(apt-cache policy libembree-dev 2>/dev/null | awk '/Candidate:/ { print $2 }')
    [[ $version == 4.* ]] && printf '%s\n' 4.3 "$version" | sort -V -C
}

# The first of the machine's own sources for Debian, other vendors' and installation discs aside.
debian_mirror() {
    apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 'Origin: Debian' \
        "Codename: $VERSION_CODENAME" 'Component: main' | awk '!/^cdrom:/ && !n++'
}

# Debian 13's headers, into $1/include. apt verifies them against Debian's archive keys; it works on
# a private state directory, so the machine's own sources and lists stay as they are.
fetch_headers() {
    local to=$1 apt=$1/apt mirror keyring=/usr/share/keyrings/debian-archive-keyring.gpg
    mirror=$(debian_mirror)
    if [ -z "$mirror" ]; then # no lists yet, as in a fresh container
        apt_update
        mirror=$(debian_mirror)
    fi
    [ -n "$mirror" ] || die "apt knows no Debian mirror for $VERSION_CODENAME. $archive_hint"
    if ! ls /usr/share/keyrings/debian-archive-"$headers_suite"-*.gpg >/dev/null 2>&1; then
        apt_install debian-archive-keyring # older ones cannot verify the newer suite
    fi

    mkdir -p "$apt"/{state/lists/partial,cache/archives/partial,empty} "$to/deb"
    : >"$apt/status"
    printf 'deb [signed-by=%s] %s %s main\n' "$keyring" "$mirror" "$headers_suite" \
        >"$apt/sources.list"
    local options=(
        -o Dir::State="$apt/state" -o Dir::State::status="$apt/status" -o Dir::Cache="$apt/cache"
        -o Dir::Etc::SourceList="$apt/sources.list" -o Dir::Etc::SourceParts="$apt/empty"
        -o Dir::Etc::Preferences="$apt/empty/none" -o Dir::Etc::PreferencesParts="$apt/empty"
        -o APT::Sandbox::User="$(id -un)" -o Acquire::Languages=none
        -o Acquire::AllowInsecureRepositories=false -o APT::Get::AllowUnauthenticated=false
        -qq
    )
    say "fetching the Embree headers: libembree-dev of Debian $headers_suite"
    apt-get "${options[@]}" update
    (cd "$to/deb" && apt-get "${options[@]}" download libembree-dev)
    dpkg-deb -x "$to"/deb/libembree-dev_*.deb "$to/deb"
    mkdir -p "$to/prefix/include" "$to/prefix/share"
    cp -r "$to/deb/usr/include/embree4" "$to/prefix/include/"
    cp "$to/deb/usr/share/doc/libembree-dev/copyright" "$to/prefix/share/headers-copyright"

    local sum
    sum=$(cd "$to/prefix/include/embree4" && LC_ALL=C sha256sum -- *.h | sha256sum | cut -d' ' -f1)
    [ "$sum" = "$headers_sha256" ] ||
        die "the headers' checksum is $sum, expected $headers_sha256. $archive_hint"
}

# Intel's library with its TBB, into $1/lib.
fetch_library() {
    local to=$1 file
    python3 -m pip --version >/dev/null 2>&1 || apt_install python3-pip
    say "fetching the Embree library: Python wheel $wheel"
    # The wheel's Python version is pinned with its checksum; it need not be this machine's.
    python3 -m pip download -q --disable-pip-version-check --no-deps --only-binary=:all: \
        --implementation cp --python-version 3.11 --abi cp311 \
        --platform manylinux_2_28_x86_64 --dest "$to/wheel" "$wheel" ||
        die "the wheel cannot be fetched. $archive_hint"
    file=$(echo "$to"/wheel/embreex-*.whl)
    echo "$wheel_sha256  $file" | sha256sum --check --status ||
        die "the wheel's checksum is $(sha256sum "$file" | cut -d' ' -f1), expected $wheel_sha256"
    python3 -m zipfile -e "$file" "$to/wheel"
    mkdir -p "$to/prefix/lib" "$to/prefix/share"
    cp "$to"/wheel/embreex.libs/lib{embree4,tbb}-*.so.* "$to/prefix/lib/"
    cp "$to"/wheel/embreex-*.dist-info/licenses/LICENSE "$to/prefix/share/library-license"
    chmod 755 "$to"/prefix/lib/*.so.* # the loader wants them executable on some file systems
    ln -s "$(cd "$to/prefix/lib" && ls libembree4-*.so.4)" "$to/prefix/lib/libembree4.so"
}

make_prefix() {
    [ "$(uname -m)" = x86_64 ] || die "no Embree 4 package for $(uname -m) here. $archive_hint"
    say "Debian 12 has no Embree 4; making $prefix from Debian 13's headers and Intel's library"
    # Built aside and renamed, so that an interrupted run leaves nothing that looks finished.
    # One that was killed leaves its folder; a later one removes it.
    find "$root" -maxdepth 1 -name '.embree.??????' -mmin +60 -exec rm -rf {} +
    work=$(mktemp -d "$root/.embree.XXXXXX")
    trap 'rm -rf "$work"' EXIT
    fetch_headers "$work"
    fetch_library "$work"
    echo "$recipe" >"$work/prefix/recipe"
    rm -rf "$prefix"
    mv "$work/prefix" "$prefix"
    say "Embree 4 is ready in $prefix"
}

install_embree() {
    if [ -n "${EMBREE_DIR:-}" ]; then
        [[ $EMBREE_DIR == /* ]] || die "EMBREE_DIR is $EMBREE_DIR, but must be an absolute path"
        [ -e "$EMBREE_DIR/include/embree4/rtcore.h" ] ||
            die "EMBREE_DIR is $EMBREE_DIR, but it has no include/embree4/rtcore.h"
        any_exists "$EMBREE_DIR"/{lib/"$(uname -m)"-linux-gnu,lib64,lib}/libembree4.{so,dylib} ||
            die "EMBREE_DIR is $EMBREE_DIR, but it has no lib/libembree4.so"
        return
    fi
    if prefix_is_current || has_system_embree; then return; fi
    [ -r /etc/os-release ] || die "cannot tell which system this is. $archive_hint"
    # shellcheck source=/dev/null
    . /etc/os-release
    if [ "${ID:-}${VERSION_ID:-}" = debian12 ]; then
        make_prefix
    elif command -v apt-get >/dev/null; then
        apt_has_embree4 || apt_update
        apt_has_embree4 || die "${PRETTY_NAME:-this system} has no package of Embree 4.3 or newer. $archive_hint"
        apt_install libembree-dev
    else
        die "${PRETTY_NAME:-This system} is not one this script can set up. $archive_hint"
    fi
}

check_rust
install_build_tools
install_embree
