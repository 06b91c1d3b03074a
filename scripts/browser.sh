# Sourced by scripts that look at pages: `run` calls a headless Chromium, which is installed if there is none.
# Wants apt.sh before it. Leaves what the browser logged in $profile/log. `check_theme` and `pictures` look at the
# pages in $folder.

browser() {
    local name
    for name in chromium chromium-browser google-chrome google-chrome-stable; do
        command -v "$name" && return
    done
    return 1
}
browser >/dev/null || apt_install chromium fonts-dejavu-core
chromium=$(browser) || die "there is still no Chromium on the PATH"

profile=$(mktemp -d)
trap 'rm -rf "$profile"' EXIT
options=(
    --headless=new --disable-gpu --hide-scrollbars --no-first-run --disable-dev-shm-usage
    --allow-file-access-from-files "--user-data-dir=$profile"
)
# Chromium has no sandbox for root.
[ "$(id -u)" -ne 0 ] || options+=(--no-sandbox)

run() { timeout 120 "$chromium" "${options[@]}" "$@" 2>"$profile/log"; }

# The option for the colors of a theme, light or dark.
colors() { echo "--blink-settings=preferredColorScheme=$([ "$1" = dark ] && echo 0 || echo 1)"; }

# Opens scripts/CHECK, which looks at the pages in $folder, in a theme. It must end in `fine`, without an error in the
# console.
check_theme() { # THEME CHECK
    local theme=$1 result
    # Time runs as fast as there is nothing to do.
    result=$(run "$(colors "$theme")" --enable-logging=stderr --virtual-time-budget=60000 --dump-dom \
        "file://$root/scripts/$2?file://$folder" |
        sed -n 's|.*<pre id="result">\(.*\)</pre>.*|\1|p') || true # what is wrong is told below
    if [[ $result != fine* ]]; then
        [ -n "$result" ] || result=$(tail -n 5 "$profile/log")
        die "$folder, $theme: $result"
    fi
    ! grep 'CONSOLE' "$profile/log" || die "$folder, $theme: the console has errors"
    say "$theme: $result"
}

# Leaves pictures of a page of $folder in a theme: NAME-THEME.png and NAME-THEME-phone.png, of these heights.
pictures() { # THEME PAGE NAME HEIGHT PHONE_HEIGHT
    local page=file://$folder/$2 picture=$folder/$3-$1
    run "$(colors "$1")" "--window-size=1280,$4" "--screenshot=$picture.png" "$page" >/dev/null
    # Chromium makes no window narrower than 500 pixels: the phone is a frame in a page.
    printf '<body style="margin:0"><iframe src="%s" style="border:0;width:360px;height:%spx"></iframe>' \
        "$page" "$5" >"$profile/phone.html"
    run "$(colors "$1")" "--window-size=360,$5" "--screenshot=$picture-phone.png" "file://$profile/phone.html" >/dev/null
}
