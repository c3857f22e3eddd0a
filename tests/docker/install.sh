#!/usr/bin/env bash
# Installs what tests/docker/run.sh needs and is missing: Debian's engine and its Compose 1.29. Debian's Compose v2 is
# that of the release after; it is unpacked into FOLDER, not installed, as FOLDER/docker-compose-v2.
#
#     tests/docker/install.sh FOLDER
set -euo pipefail
folder="$1"
mkdir --parents "$folder"
folder="$(cd "$folder" && pwd)"

# The command a package is known by, and the package.
missing=()
while read -r command package; do
    if ! command -v "$command" >/dev/null; then missing+=("$package"); fi
done <<'PACKAGES'
dockerd docker.io
docker docker.io
docker-compose docker-compose
iptables iptables
ip iproute2
xxhsum xxhash
PACKAGES
if [ "${#missing[@]}" -gt 0 ]; then
    apt-get update
    DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends "${missing[@]}"
fi
if [ -x "$folder/docker-compose-v2" ]; then exit 0; fi

# From the same place as this machine's packages, with lists of its own: nothing else is to come from that release.
release=trixie
# shellcheck disable=SC2016 # It is apt-get that expands it.
site="$(apt-get indextargets --format '$(SITE)' 'Created-By: Packages' 'Label: Debian' | sed --quiet 1p)"
apt="$(mktemp --directory)"
trap 'rm --recursive --force "$apt"' EXIT
mkdir --parents "$apt/lists/partial" "$apt/cache/archives/partial"
echo "deb $site $release main" > "$apt/sources.list"
options=(
    --option "Dir::Etc::SourceList=$apt/sources.list" --option Dir::Etc::SourceParts=/dev/null
    --option "Dir::State::Lists=$apt/lists" --option "Dir::Cache=$apt/cache" --option APT::Sandbox::User=root
    --option Acquire::Languages=none --option Acquire::IndexTargets::deb::DEP-11::DefaultEnabled=false
)
apt-get "${options[@]}" update
(cd "$apt" && apt-get "${options[@]}" download "docker-compose/$release")
dpkg --extract "$apt"/docker-compose_*.deb "$apt/root"
install "$apt/root/usr/libexec/docker/cli-plugins/docker-compose" "$folder/docker-compose-v2"
