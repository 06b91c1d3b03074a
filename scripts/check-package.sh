#!/usr/bin/env bash
# What `cargo package` makes of the bindings, as somebody who downloads it has it: unpacked far from the
# checkout, its tests pass with EMBREE_DIR set, headers that are too old are refused, and documentation
# builds without it.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/apt.sh
. "$root/scripts/apt.sh"

prefix=${EMBREE_DIR:-}
for folder in "$root/.embree" /usr/local /usr; do
    [ -n "$prefix" ] || [ ! -e "$folder/include/embree4/rtcore.h" ] || prefix=$folder
done
[ -n "$prefix" ] || die "there is no Embree; run scripts/setup.sh"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$root"
cargo package --locked --no-verify --allow-dirty --quiet --package embree4-sys --target-dir "$work/package"
tar -xzf "$work"/package/package/embree4-sys-*.crate -C "$work"
cd "$work"/embree4-sys-*/
export CARGO_TARGET_DIR="$work/target"

say "tests of the package"
EMBREE_DIR=$prefix cargo test --locked --quiet

say "documentation without Embree"
EMBREE_DIR='' DOCS_RS=1 RUSTDOCFLAGS='-D warnings' cargo doc --locked --quiet --no-deps

say "a header of Embree 4.2"
mkdir -p "$work/old/include"
cp -rL "$prefix/include/embree4" "$work/old/include/"
sed -i 's/^#define RTC_VERSION .*/#define RTC_VERSION 40200/' "$work/old/include/embree4/rtcore_config.h"
for folder in lib "lib/$(uname -m)-linux-gnu" lib64; do
    [ ! -e "$prefix/$folder/libembree4.so" ] || ln -sfn "$prefix/$folder" "$work/old/lib"
done
if EMBREE_DIR=$work/old cargo build --locked 2>"$work/log"; then
    die "it was taken"
fi
grep -q 'this is Embree 4.2.0, but 4.3 or a newer 4 is needed' "$work/log" ||
    die "it was refused for another reason: $(cat "$work/log")"
