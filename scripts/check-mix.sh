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

check=file://$root/scripts/check-mix.html?file://$folder
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
    run "$colors" --window-size=1280,1500 "--screenshot=$folder/mix-$theme.png" "file://$folder/srgb.html" >/dev/null
    # Chromium makes no window narrower than 500 pixels: the phone is a frame in a page.
    printf '<body style="margin:0"><iframe src="file://%s" style="%s"></iframe>' \
        "$folder/srgb.html" 'border:0;width:360px;height:1700px' >"$profile/phone.html"
    run "$colors" --window-size=360,1700 "--screenshot=$folder/mix-$theme-phone.png" \
        "file://$profile/phone.html" >/dev/null
    say "$theme: $result"
done
say "pictures: $folder/mix-*.png"
