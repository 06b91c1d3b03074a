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

check=file://$root/scripts/check-page.html?file://$folder
for theme in light dark; do
    # 0 is dark, 1 is light; time runs as fast as there is nothing to do.
    colors=--blink-settings=preferredColorScheme=$([ $theme = dark ] && echo 0 || echo 1)
    result=$(run "$colors" --enable-logging=stderr --virtual-time-budget=60000 --dump-dom "$check" |
        sed -n 's|.*<pre id="result">\(.*\)</pre>.*|\1|p') || true # what is wrong is told below
    if [[ $result != fine* ]]; then
        [ -n "$result" ] || result=$(tail -n 5 "$profile/log")
        die "$folder, $theme: $result"
    fi
    ! grep 'CONSOLE' "$profile/log" || die "$folder, $theme: the console has errors"
    for page in during after; do
        run "$colors" --window-size=1280,2600 "--screenshot=$folder/$page-$theme.png" \
            "file://$folder/$page.html" >/dev/null
        # Chromium makes no window narrower than 500 pixels: the phone is a frame in a page.
        printf '<body style="margin:0"><iframe src="file://%s" style="%s"></iframe>' \
            "$folder/$page.html" 'border:0;width:360px;height:5200px' >"$profile/phone.html"
        run "$colors" --window-size=360,5200 "--screenshot=$folder/$page-$theme-phone.png" \
            "file://$profile/phone.html" >/dev/null
    done
    say "$theme: $result"
done
say "pictures: $folder/*.png"
