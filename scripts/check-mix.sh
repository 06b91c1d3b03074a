#!/usr/bin/env bash
# Opens a page of `bdpm mix --report` in a browser, at the widths of phones and desktops, light and dark, and
# moves its sliders: the picture and the error change, the error and the command are those of `bdpm mix`, and the
# picture of all lights is the PNG. Leaves pictures of the page beside it.
#
#   scripts/check-mix.sh FOLDER     with CURVE.html and CURVE.png for each tone curve, and mixtures.js
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/apt.sh
. "$root/scripts/apt.sh"

folder=$(cd "$1" && pwd)
for name in {srgb,agx,filmic}.{html,png} mixtures.js; do
    [ -e "$folder/$name" ] || die "$folder has no $name"
done

# shellcheck source=scripts/browser.sh
. "$root/scripts/browser.sh"

for theme in light dark; do
    check_theme $theme check-mix.html
    pictures $theme srgb.html mix 1500 1700
done
say "pictures: $folder/mix-*.png"
