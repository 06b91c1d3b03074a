#!/usr/bin/env bash
# Opens a report of `bdpm reproduce` in a browser, at the width of phones and desktops, and checks that
# all figures have loaded and nothing is cut off. Installs Chromium if there is none. Leaves a picture
# of the report at both widths beside it.
#
#   scripts/check-report.sh FOLDER
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/apt.sh
. "$root/scripts/apt.sh"

folder=$(cd "$1" && pwd)
[ -e "$folder/report.html" ] || die "$folder has no report.html; bdpm reproduce writes one"

# shellcheck source=scripts/browser.sh
. "$root/scripts/browser.sh"

# Chromium makes no window narrower than 500 pixels: the phone is a frame in a page.
check=file://$root/scripts/check-report.html?file://$folder/report.html
result=$(run --dump-dom "$check" |
    sed -n 's|.*<pre id="result">\(.*\)</pre>.*|\1|p') || true # what is wrong is told below
if [[ $result != fine* ]]; then
    [ -n "$result" ] || result=$(tail -n 5 "$profile/log")
    die "$folder/report.html: $result"
fi

phone=$profile/phone.html
printf '<body style="margin:0"><iframe src="file://%s" style="%s"></iframe>' \
    "$folder/report.html" 'border:0;width:390px;height:12000px' >"$phone"
run --window-size=1280,8000 "--screenshot=$folder/desktop.png" "file://$folder/report.html" >/dev/null
run --window-size=390,12000 "--screenshot=$folder/phone.png" "file://$phone" >/dev/null
say "$result; pictures: $folder/desktop.png, $folder/phone.png"
