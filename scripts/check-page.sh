#!/usr/bin/env bash
# Opens pages of `bdpm render --report` in a browser, one of a render under way and one of a render that is
# over, at the widths of phones and desktops, light and dark: nothing is cut off, text stands out, nothing is
# asked for elsewhere, no error is logged, zoom and place survive that the page loads itself again, and the
# picture is the PNG. Leaves pictures of the pages beside them.
#
#   scripts/check-page.sh FOLDER     with during.html, after.html and image.png
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/apt.sh
. "$root/scripts/apt.sh"

folder=$(cd "$1" && pwd)
for name in during.html after.html image.png; do
    [ -e "$folder/$name" ] || die "$folder has no $name"
done

# shellcheck source=scripts/browser.sh
. "$root/scripts/browser.sh"

for theme in light dark; do
    check_theme $theme check-page.html
    for page in during after; do
        pictures $theme $page.html $page 2600 5200
    done
done
say "pictures: $folder/*.png"
