#!/bin/bash
# check.sh PACKAGE.deb: installs the package in a bare Debian 12 and runs the program there; builds the example of the
# library against the unpacked package in another folder. The bare system comes from debootstrap, which needs root and a
# mirror, and is kept in build/ci; without it the program runs from the unpacked package. Ends at the first failure.
set -euo pipefail
package=$(realpath "$1")
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
folder=$(mktemp -d)
trap 'rm -rf --one-file-system "$folder"' EXIT

fail() {
    echo "check.sh: $1" >&2
    exit 1
}

# has_results FOLDER: what the quick run of scripts/fra_comparison.lua leaves.
has_results() {
    [ -s "$1/identified.json" ] || fail "the run left no identified.json"
    compgen -G "$1/*.png" >/dev/null || fail "the run left no plot"
}

in_bare_system() {
    local root=$folder/root
    mkdir "$root"
    tar -C "$root" -xf build/ci/bookworm.tar
    echo force-unsafe-io >"$root/etc/dpkg/dpkg.cfg.d/unsafe-io" # it is thrown away anyway
    cp /etc/resolv.conf "$root/etc/resolv.conf"
    cp "$package" "$root/tmp/tribode.deb"
    chmod a+r "$root/tmp/tribode.deb"
    chroot "$root" apt-get -q update
    chroot "$root" env DEBIAN_FRONTEND=noninteractive apt-get -q install -y --no-install-recommends /tmp/tribode.deb
    chroot "$root" tribode --version
    # As any user, in a folder of his.
    chroot --userspec=nobody:nogroup "$root" sh -c 'mkdir /tmp/work && cd /tmp/work &&
        tribode run scripts/fra_comparison.lua --quick --quiet -o results'
    has_results "$root/tmp/work/results"
}

unpacked=$folder/moved
dpkg-deb -x "$package" "$unpacked"
mkdir -p build/ci
if [ ! -f build/ci/bookworm.tar ] && [ "$(id -u)" -eq 0 ] && command -v debootstrap >/dev/null; then
    mirror=$(sed -n 's/^URIs: *\(.*debian\)\/*$/\1/p' /etc/apt/sources.list.d/*.sources 2>/dev/null | head -n 1)
    if debootstrap --variant=minbase bookworm "$folder/base" "${mirror:-http://deb.debian.org/debian}"; then
        tar -C "$folder/base" -cf build/ci/bookworm.tar.part .
        mv build/ci/bookworm.tar.part build/ci/bookworm.tar
    fi
    rm -rf --one-file-system "$folder/base"
fi
if [ -f build/ci/bookworm.tar ] && [ "$(id -u)" -eq 0 ]; then
    in_bare_system
    how='installed and run in a bare Debian 12'
else
    "$unpacked/usr/bin/tribode" run scripts/fra_comparison.lua --quick --quiet -o "$folder/results"
    has_results "$folder/results"
    how='left out: no bare system (root, debootstrap and a mirror); run from the unpacked package'
fi

# Moved, it takes what lies beside it.
echo 'print "from the moved folder"' >"$unpacked/usr/share/tribode/scripts/moved.lua"
said=$("$unpacked/usr/bin/tribode" run scripts/moved.lua --quiet -o "$folder/moved_run")
[[ $said == *'from the moved folder'* ]] || fail "the moved program did not run its own scripts, but said: $said"

# The example: what it calculates beside what is known in closed form, in the last two columns of each line.
cmake -S examples/library -B "$folder/example" -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$unpacked/usr" \
    >"$folder/cmake.log" || { cat "$folder/cmake.log"; fail "cmake found no package"; }
cmake --build "$folder/example"
grep -q "tribode_DIR:PATH=$unpacked/" "$folder/example/CMakeCache.txt" || fail "cmake found another package"
"$folder/example/example" | tee "$folder/example.txt"
awk 'function off(a, b) { return a > b ? a - b : b - a }
    { ++lines; if (off($(NF - 1), $NF) > 1e-9) { print "differs: " $0; wrong = 1 } }
    END { if (lines != 9) { print lines + 0 " lines, must be 9"; wrong = 1 } exit wrong }' "$folder/example.txt" ||
    fail "the example is wrong"
echo "$how; the example agrees with its closed forms"
