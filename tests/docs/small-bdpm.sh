#!/usr/bin/env bash
# Runs the program with the given arguments at small sizes: short times, few pixels, paths and iterations.
set -euo pipefail
subcommand=${1:-}
arguments=()
has=" "
previous=
# The lesser of the number $1 and $2.
at_most() { if [ "$1" -gt "$2" ]; then echo "$2"; else echo "$1"; fi; }

renders() { case $subcommand in render | measure | analyze | calibrate) true ;; *) false ;; esac; }

for argument; do
    if renders; then
        case $previous in
            --time) argument=0.5s ;;
            --target-error) argument=60% ;;
            --resolution) argument=16x16 ;;
            --crop) argument=2,4,8,8 ;;
            --light-paths) argument=$(at_most "$argument" 500) ;;
            --camera-paths) argument=$(at_most "$argument" 2) ;;
            --iterations) argument=$(at_most "$argument" 32) ;;
        esac
    fi
    arguments+=("$argument")
    has+="$argument "
    previous=$argument
done

# Adds the arguments unless one of them, or of the words after `unless`, is there.
add() {
    local word given=()
    while [ "$1" != unless ]; do given+=("$1"); shift; done
    for word; do [[ $has != *" $word "* ]] || return 0; done
    arguments+=("${given[@]}")
}

case $subcommand in
    render)
        add --resolution 16x16 unless --resolution --plan --resume
        if [[ $has == *" --iterations "* ]]; then
            add --light-paths 500 unless --light-paths --plan --resume
        else
            add --time 0.5s unless --time --target-error --plan
        fi
        ;;
    measure)
        add --time 1s unless --time --target-error
        ;;
    analyze)
        add --resolution 16x16 unless --resolution
        add --light-paths 500 unless --light-paths
        add --camera-paths 2 unless --camera-paths
        add --iterations 32 unless --iterations --time
        ;;
    calibrate)
        add --resolution 16x16 unless --resolution
        add --time 0.5s unless --time
        ;;
esac
exec "$BDPM_PROGRAM" "${arguments[@]}"
