# Installing Debian packages: sourced by the scripts that need some.

say() { printf '%s: %s\n' "$(basename "$0" .sh)" "$*"; }
die() { printf '%s: error: %s\n' "$(basename "$0" .sh)" "$*" >&2; exit 1; }

can_be_root() {
    [ "$(id -u)" -eq 0 ] ||
        { command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [ -t 0 ]; }; }
}

as_root() {
    can_be_root || die "neither root nor able to use sudo; ask an administrator to run: $*"
    if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi
}

apt_update() {
    say "refreshing the package lists (apt-get update)"
    as_root apt-get update -qq
}

apt_get_install() {
    # apt-get's -qq still lets dpkg report every file it unpacks.
    as_root env DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -qq -o Dpkg::Use-Pty=0 --no-install-recommends "$@" >/dev/null
}

apt_install() {
    command -v apt-get >/dev/null ||
        die "missing, and there is no apt-get to install it with: $*. Install the equivalent of" \
            "these Debian packages with your system's package manager and run this again."
    can_be_root || die "neither root nor able to use sudo; ask an administrator to run:" \
        "apt-get update && apt-get install $*"
    say "installing system packages: $*"
    # Package lists may be absent or too old to fetch from, and an interrupted installation may be
    # half configured; mend that only then.
    apt_get_install "$@" 2>/dev/null && return
    as_root dpkg --configure -a >/dev/null
    apt_update
    apt_get_install "$@"
}
