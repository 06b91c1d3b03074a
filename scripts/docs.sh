#!/usr/bin/env bash
# Builds the site: all pages with search and formulas, and the documentation of the library, in out/docs. The tools are
# installed into target/docs-tools once, at pinned versions. After that nothing is fetched.
#
#   scripts/docs.sh            everything
#   scripts/docs.sh --pages    the pages alone, which takes seconds
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
cargo=${CARGO:-cargo}
target=${CARGO_TARGET_DIR:-target}
tools=${DOCS_TOOLS:-$target/docs-tools}
book=$target/docs-book
out=out/docs

# The pinned tools. mdbook-katex compiles QuickJS, which wants a C compiler, as Embree's bindings do.
mdbook=0.5.4
katex=0.10.0

# shellcheck source=scripts/apt.sh
. "$root/scripts/apt.sh"

# installed NAME VERSION: whether the tool is there in this version.
installed() { [ "$("$tools/bin/$1" --version 2>/dev/null | grep -oE '[0-9]+\.[0-9]+\.[0-9]+' | head -n 1)" = "$2" ]; }

install_tool() {
    local name=$1 version=$2
    shift 2
    ! installed "$name" "$version" || return 0
    say "installing $name $version into $tools, once"
    "$cargo" install --quiet --locked --force --root "$tools" "$name@$version" "$@" ||
        die "$name $version cannot be installed. Give a folder with bin/mdbook and bin/mdbook-katex in DOCS_TOOLS."
}

command -v python3 >/dev/null || apt_install python3
install_tool mdbook "$mdbook" --no-default-features --features search
install_tool mdbook-katex "$katex"

rm -rf "$book" "$out"
mkdir -p "$book" out
cp scripts/docs_book.toml "$book/book.toml"
cp scripts/docs.css scripts/docs_pages.py "$book/"
python3 scripts/docs_pages.py write "$book/src"
PATH="$(realpath "$tools")/bin:$PATH" mdbook build "$book" --dest-dir "$(realpath out)/docs"
if [ "${1:-}" != --pages ]; then
    "$cargo" doc --locked --no-deps --workspace --exclude bdpm-python
    mkdir -p "$out/rust"
    cp -r "$target/doc/." "$out/rust"
fi
python3 scripts/docs_pages.py check "$out"
say "the site is $out/index.html"
