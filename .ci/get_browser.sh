#!/usr/bin/env bash
# Debian's Chromium and its driver, for the test of the live view's page: as root, or with sudo, through apt-get.
# Where they cannot be had that test says so and is skipped.
set -uo pipefail
command -v chromedriver >/dev/null && exit 0
root=
if [ "$(id -u)" != 0 ]; then root="sudo --non-interactive"; fi
if command -v apt-get >/dev/null && $root true 2>/dev/null; then
    $root apt-get update --quiet=2 &&
        $root env DEBIAN_FRONTEND=noninteractive apt-get install --quiet=2 --yes --no-install-recommends \
            chromium chromium-driver && exit 0
fi
echo "no browser: the test of the live view's page will be skipped" >&2
