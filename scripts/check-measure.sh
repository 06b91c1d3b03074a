#!/usr/bin/env bash
# Opens pages of `bdpm measure --by-light --report` in a browser, at the widths of phones and desktops, light and
# dark, and moves their sliders: at full strength the script writes what the program wrote, and under dimmed lights
# the numbers that follow from the JSON of the measurement. Leaves pictures of the page beside it.
#
#   scripts/check-measure.sh FOLDER     with {,plain-}office.html, {,plain-}unknown.html and mixtures.js
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/apt.sh
. "$root/scripts/apt.sh"

folder=$(cd "$1" && pwd)
for name in {,plain-}{office,unknown}.html mixtures.js; do
    [ -e "$folder/$name" ] || die "$folder has no $name"
done

# shellcheck source=scripts/browser.sh
. "$root/scripts/browser.sh"

for theme in light dark; do
    check_theme $theme check-measure.html
    pictures $theme office.html measure 3600 5200
done
say "pictures: $folder/measure-*.png"
