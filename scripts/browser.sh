# Sourced by scripts that look at pages: `run` calls a headless Chromium, which is installed if there is none.
# Wants apt.sh before it. Leaves what the browser logged in $profile/log.

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
