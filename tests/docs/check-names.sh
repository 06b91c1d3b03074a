#!/usr/bin/env bash
# Stands for make, cargo, blender and the scripts: only checks that the targets and files exist.
set -euo pipefail
fail() {
    echo "$(basename "$0"): there is no $*" >&2
    exit 1
}
program=$(basename "$0")
previous=
for argument; do
    case $program:$previous in
        make:*) grep -q "^$argument:" Makefile || fail "target $argument" ;;
        cargo:--example) [ -e "examples/$argument.rs" ] || [ -e "examples/$argument/main.rs" ] || fail "example $argument" ;;
        cargo:--bench) [ -e "benches/$argument.rs" ] || [ -e "benches/$argument/main.rs" ] || fail "bench $argument" ;;
        cargo:--test) [ -e "tests/$argument.rs" ] || [ -e "tests/$argument/main.rs" ] || fail "test $argument" ;;
        *.sh:*) [[ $argument != */* ]] || [ -e "$argument" ] || fail "file $argument" ;;
        blender:--python) [ -e "$argument" ] || fail "file $argument" ;;
    esac
    previous=$argument
done
