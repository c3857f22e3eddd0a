#!/usr/bin/env bash
# Makes the image that docker/Dockerfile builds in, where none can be pulled: this machine's own C compiler and Rust
# toolchain and the crates that Cargo.lock names, so that the build itself needs no network.
#
#     tests/docker/builder.sh TAG
set -euo pipefail
tag="$1"
here="$(cd "$(dirname "$0")/../.." && pwd)"
folder="$(mktemp --directory)"
trap 'rm --recursive --force "$folder"' EXIT
root="$folder/root"

# The packages of a compiler and a shell, with all that they need, as they are installed here.
packages="$(apt-cache depends --recurse --installed --no-recommends --no-suggests --no-conflicts --no-breaks \
    --no-replaces --no-enhances gcc libc6-dev coreutils dash sed | grep '^[a-z0-9]' | cut --delimiter=: --fields=1 \
    | sort --unique)"
mkdir --parents "$root/usr/bin" "$root/usr/sbin" "$root/usr/lib" "$root/usr/lib64" "$root/tmp"
for link in bin sbin lib lib64; do ln --symbolic "usr/$link" "$root/$link"; done
for package in $packages; do
    # Some are virtual, and some are no package of this machine's own architecture.
    dpkg-query --listfiles "$package" 2>/dev/null || true
done | grep --invert-match --extended-regexp '^/(\.$|usr/share/(doc|man|info|locale|lintian))' | sort --unique \
    | while IFS= read -r file; do
        if [ -f "$file" ] || [ -L "$file" ]; then printf '%s\n' "${file#/}"; fi
    done > "$folder/files"
# Packages name files where they stood before /bin and /lib became links; through the links they arrive all the same.
tar --create --directory=/ --no-recursion --files-from="$folder/files" \
    | tar --extract --directory="$root" --keep-directory-symlink
ln --symbolic --force gcc "$root/usr/bin/cc"

# The toolchain that rust-toolchain.toml names, and the crates.
sysroot="$(cd "$here" && rustc --print sysroot)"
mkdir --parents "$root/usr/local/bin" "$root/usr/local/lib" "$root/usr/local/cargo"
cp "$sysroot/bin/cargo" "$sysroot/bin/rustc" "$root/usr/local/bin/"
cp --recursive "$sysroot/lib/." "$root/usr/local/lib/"
(cd "$here" && cargo vendor --locked --versioned-dirs "$root/crates" 2>"$folder/vendor.log") >/dev/null \
    || { cat "$folder/vendor.log" >&2; exit 1; }
cat > "$root/usr/local/cargo/config.toml" <<'TOML'
[source.crates-io]
replace-with = "vendored"

[source.vendored]
directory = "/crates"

[net]
offline = true
TOML
tar --create --directory="$root" . \
    | docker import --change 'ENV PATH=/usr/local/bin:/usr/bin:/bin CARGO_HOME=/usr/local/cargo' - "$tag" >/dev/null
