#!/usr/bin/env bash
# Opens pages in a browser, at the widths of phones and desktops, light and dark, and looks at them by
# scripts/check-KIND.html: nothing is cut off, text stands out, nothing is asked for elsewhere, no error is logged, and
# what that page says of its kind. Leaves pictures of the pages beside them.
#
#   scripts/check-pages.sh page FOLDER      of `bdpm render --report`, of a render under way and of one that is over
#   scripts/check-pages.sh mix FOLDER       of `bdpm mix --report`, for each tone curve, and its mixtures.js
#   scripts/check-pages.sh measure FOLDER   of `bdpm measure --by-light --report`, and their mixtures.js
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/apt.sh
. "$root/scripts/apt.sh"

kind=$1 folder=$(cd "$2" && pwd)
# Pages with the heights of their pictures on desktops and phones.
case $kind in
    page) names=({during,after}.html image.png) pages=("during 2600 5200" "after 2600 5200") ;;
    mix) names=({srgb,agx,filmic}.{html,png} mixtures.js) pages=("srgb 1500 1700") ;;
    measure) names=({,plain-}{office,unknown}.html mixtures.js) pages=("office 3600 5200") ;;
    *) die "unknown kind $kind: page, mix or measure" ;;
esac
for name in "${names[@]}"; do
    [ -e "$folder/$name" ] || die "$folder has no $name"
done

# shellcheck source=scripts/browser.sh
. "$root/scripts/browser.sh"

for theme in light dark; do
    check_theme "$theme" "check-$kind.html"
    for page in "${pages[@]}"; do
        read -r name desktop phone <<<"$page"
        pictures "$theme" "$name.html" "$name" "$desktop" "$phone"
    done
done
say "pictures: $folder/*.png"
