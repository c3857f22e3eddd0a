#!/usr/bin/env bash
# The simulated arena in containers, for real: builds the image, brings the arena up, kills every service in hover, stops
# it, and reads in its recording that no vehicle ever left the hall.
#
#     tests/docker/run.sh [IMAGE]
#
# Uses the Docker engine that runs, else starts one of its own (as root) and ends it. With IMAGE, nothing is built.
# COMPOSE names the Compose to use (default: docker-compose, else the docker command's own).
set -euo pipefail
here="$(cd "$(dirname "$0")/../.." && pwd)"
work="$(mktemp --directory)"
image="${1:-flyarena-test}"
export FLYARENA_IMAGE="$image" FLYARENA_SCENARIO=double-flip FLYARENA_SEED=1 FLYARENA_RECORDING=test
export FLYARENA_VOLUME=flyarena-test-recordings
export COMPOSE_PROJECT_NAME=flyarena-test COMPOSE_FILE="$here/docker/compose.yaml" COMPOSE_DOCKER_CLI_BUILD=0
services=(learner flip-manager logger vicon-bridge estimator hover-controller radio-bridge simulator director)
# How long to wait before giving up; a healthy arena needs a small part of it.
patience_s=120
passed=0
engine=

say() { printf '[%4d s] %s\n' "$SECONDS" "$*"; }
pass() { passed=$((passed + 1)); say "ok: $*"; }
fail() {
    say "FAILED: $*"
    compose logs --tail=30 2>&1 | tail -n 200 || true
    exit 1
}

compose() { ${COMPOSE:-docker-compose} "$@"; }
# Compose 1.29 takes a second for what the labels tell at once.
container() {
    docker ps --all --quiet --filter "label=com.docker.compose.project=$COMPOSE_PROJECT_NAME" \
        --filter "label=com.docker.compose.service=$1"
}
inspect() { docker inspect --format "$2" "$(container "$1")"; }
# The front door, in one of the arena's containers.
arena() { timeout 20 docker exec "$(container "$1")" /arena "${@:2}"; }

clean_up() {
    local profile
    for profile in -hardware -replay ''; do
        local file=".${profile#-}"
        COMPOSE_FILE="$here/docker/compose${file%.}.yaml" COMPOSE_PROJECT_NAME="flyarena-test$profile" FLYARENA_VICON=x \
            FLYARENA_DATA_LINK=x FLYARENA_COMMAND_LINK=x compose down --volumes --timeout 2 >/dev/null 2>&1 || true
    done
    if [ $# -eq 0 ]; then docker image rm --force flyarena-test flyarena-test-builder >/dev/null 2>&1 || true; fi
    if [ -n "$engine" ]; then
        kill "$engine" 2>/dev/null || true
        wait "$engine" 2>/dev/null || true
    fi
    rm --recursive --force "$work"
}
trap 'clean_up "$@"' EXIT

start_engine() {
    if docker info >/dev/null 2>&1; then return; fi
    say "no engine runs: starting one"
    export DOCKER_HOST="unix://$work/docker.sock"
    # No network but those that a test makes; nothing is forwarded to or from this machine.
    dockerd --host "$DOCKER_HOST" --data-root "$work/data" --exec-root "$work/exec" --pidfile "$work/pid" \
        --bridge none --ip-forward=false --ip-masq=false >"$work/dockerd.log" 2>&1 &
    engine=$!
    for _ in $(seq 60); do
        if docker info >/dev/null 2>&1; then return; fi
        sleep 0.5
    done
    tail -n 30 "$work/dockerd.log"
    say "FAILED: no engine could be started"
    exit 1
}

# Waits until a command succeeds.
wait_for() {
    local what="$1" until=$((SECONDS + patience_s))
    shift
    until "$@"; do
        if [ "$SECONDS" -ge "$until" ]; then fail "waited ${patience_s} s for: $what"; fi
        sleep 0.3
    done
}

# What the director last said of the vehicle since something was done to the arena: what the arena believes.
since=1970-01-01T00:00:00Z
from_now_on() { since="$(date --utc +%FT%T.%NZ)"; }
vehicle_line() { docker logs --since "$since" "$(container director)" 2>/dev/null | grep '^vehicle 1  .*at (' | tail -n 1; }
believed_m() { vehicle_line | sed -n 's/.*at ([^,]*, [^,]*, \([^)]*\)) m.*/\1/p'; }
hovering() { vehicle_line | grep --quiet Tracking && awk -v z="$(believed_m)" 'BEGIN { exit !(z > 3.5) }'; }
# Where the vehicle truly is: x, y, z.
truth_m() { arena simulator echo plant/truth --count 1 --json | sed -n 's/.*"position_m":\(.[^]}]*\).*/\1/p' | tr -dc '0-9.,+e-'; }
# Whether it hovers or lies on the floor, truly: not on its way.
settled() {
    local first second
    first="$(truth_m)" && sleep 1 && second="$(truth_m)" || return 1
    awk -F, -v OFS=, 'NR == 1 { split($0, a) } NR == 2 { split($0, b) } END {
        for (i = 1; i <= 3; i++) d += (a[i] - b[i]) ^ 2
        exit !(length(b) == 3 && d < 0.25 && (b[3] < 0.2 || b[3] > 3.5)) }' <<<"$first"$'\n'"$second"
}
running() { [ "$(inspect "$1" '{{.State.Running}}')" = true ]; }
healthy() { [ "$(inspect "$1" '{{.State.Health.Status}}')" = healthy ]; }
said() { docker logs "$(container "$1")" 2>&1 | grep --quiet "$2"; }

build() {
    "$here/tests/docker/builder.sh" flyarena-test-builder
    say "the builder's image is there"
    compose build --build-arg BUILDER=flyarena-test-builder run >"$work/build.log" 2>&1 \
        || { tail -n 60 "$work/build.log"; fail "the image does not build"; }
    say "the image is there"
}

check_image() {
    local bytes user
    bytes="$(docker image inspect --format '{{.Size}}' "$image")"
    user="$(docker image inspect --format '{{.Config.User}}' "$image")"
    [ "$bytes" -le 30000000 ] || fail "the image has $bytes bytes, more than 30 MB"
    [ "$user" = 65532:65532 ] || fail "the image runs as $user"
    pass "an image of $bytes bytes, user $user"
}

check_confinement() {
    local service found
    for service in run "${services[@]}"; do
        found="$(inspect "$service" '{{.HostConfig.ReadonlyRootfs}} {{.HostConfig.CapDrop}} {{.HostConfig.SecurityOpt}} {{.Config.User}} {{.HostConfig.Privileged}}')"
        [ "$found" = 'true [ALL] [no-new-privileges:true] 65532:65532 false' ] || fail "$service runs as: $found"
    done
    pass "every container: read-only, no capabilities, no new privileges, not root"
}

check_health() {
    local service
    for service in run "${services[@]}"; do wait_for "healthy $service" healthy "$service"; done
    pass "every container says it is healthy"
}

# A process that dies comes back by itself.
crash() {
    local before
    before="$(inspect "$1" '{{.RestartCount}}')"
    kill -KILL "$(inspect "$1" '{{.State.Pid}}')"
    restarted() { running "$1" && [ "$(inspect "$1" '{{.RestartCount}}')" -gt "$before" ]; }
    wait_for "restart of $1" restarted "$1"
    from_now_on
    wait_for "hovering vehicle after $1 was restarted" hovering
    pass "$1 crashed in hover and was restarted"
}

# A container that is killed stays away until somebody starts it again.
kill_and_start() {
    compose kill "$1" >/dev/null 2>&1
    local place='no simulator, no vehicle'
    if [ "$1" != simulator ]; then
        sleep 3
        wait_for "vehicle that recovered or landed without $1" settled
        place="the vehicle at ($(truth_m)) m"
    fi
    compose start "$1" >/dev/null 2>&1
    from_now_on
    # A vehicle that came down because nobody commanded it keeps its motors off until a person releases them.
    if [ "$1" = hover-controller ] || [ "$1" = radio-bridge ]; then
        wait_for "vehicle that is released" arena flip-manager stop --release
    fi
    wait_for "hovering vehicle after $1 came back" hovering
    pass "$1 killed in hover: $place; hovering again once it was back"
}

check_stop() {
    compose stop >/dev/null 2>&1
    said director '^landed$' || fail "the director did not land: $(docker logs --tail 3 "$(container director)" 2>&1)"
    pass "stopped: landed first"
    docker cp "$(container logger)":/flyarena/recordings/. "$work/recordings" >/dev/null
    # The logger was killed twice, so there are three recordings; the last one was sealed when it was told to end.
    local open
    open="$(find "$work/recordings" -name 'test-3*.part')"
    [ -e "$work/recordings/test-3.mcap" ] && [ -z "$open" ] || { ls -l "$work/recordings"; fail "not sealed: $open"; }
    pass "the recording is sealed"
}

# The front door, on the recordings.
on_recordings() {
    docker run --rm --network none --user 0:0 --cap-drop ALL --volume "$work/recordings:/flyarena/recordings" "$image" "$@"
}

recover() {
    local part
    for part in "$work"/recordings/*.part; do
        on_recordings recover "recordings/$(basename "$part")" >"$work/recovered.log" 2>&1 \
            || { cat "$work/recovered.log"; fail "$(basename "$part") cannot be recovered"; }
        say "$(tail -n 1 "$work/recovered.log")"
    done
}

# Where the vehicle truly was, from every recording.
check_hall() {
    local recording found rows=0 bad=0
    for recording in "$work"/recordings/*.mcap; do
        case "$recording" in *.[0-9][0-9][0-9][0-9].mcap) continue ;; esac
        on_recordings export "recordings/$(basename "$recording")" --csv --topic plant/truth >"$work/truth.csv" 2>"$work/said" \
            || say "$(basename "$recording"): $(tail -n 1 "$work/said")"
        found="$(awk -F, -v width=10 -v height=10 '
            NR == 1 { for (i = 1; i <= NF; i++) at[$i] = i
                      for (name in at) { if (name ~ /position_m\.x/) x = at[name]
                                         if (name ~ /position_m\.y/) y = at[name]
                                         if (name ~ /position_m\.z/) z = at[name] } next }
            { rows++
              if (!(x && y && z) || 2 * $x > width || -2 * $x > width || 2 * $y > width || -2 * $y > width \
                  || $z < -0.1 || $z > height) bad++ }
            END { print rows + 0, bad + 0 }' "$work/truth.csv")"
        say "$(basename "$recording"): ${found% *} true states"
        [ "${found% *}" -gt 100 ] || fail "$(basename "$recording") does not tell where the vehicle was"
        rows=$((rows + ${found% *})) bad=$((bad + ${found#* }))
    done
    [ "$rows" -gt 1000 ] || fail "the recordings hold no more than $rows true states"
    [ "$bad" -eq 0 ] || fail "$bad of $rows true states lie outside the hall"
    pass "$rows true states, all in the hall"
}

# The recording, put back on a bus of its own: the services take it as live data, and playback ends by itself.
check_replay() {
    export COMPOSE_FILE="$here/docker/compose.replay.yaml" COMPOSE_PROJECT_NAME=flyarena-test-replay
    FLYARENA_RECORDING=test-3 compose up --detach --no-build >/dev/null 2>&1 || fail "the replay does not come up"
    tracks() { arena estimator echo vehicle/state --count 1 --json --domain replay --run 1 | grep --quiet '"tracking":"TRACKING"'; }
    wait_for "estimator that tracks in the replay" tracks
    pass "a replay: the estimator tracks"
    compose down --timeout 5 >/dev/null 2>&1
}

# The same image before equipment that is not there: every program runs and nothing flies.
check_hardware() {
    export COMPOSE_FILE="$here/docker/compose.hardware.yaml" COMPOSE_PROJECT_NAME=flyarena-test-hardware
    export FLYARENA_VICON=127.0.0.1:51001 FLYARENA_DATA_LINK=127.0.0.1:52000 FLYARENA_COMMAND_LINK=127.0.0.1:52100
    compose up --detach --no-build >/dev/null 2>&1 || fail "the hardware profile does not come up"
    local service
    for service in run logger vicon-bridge radio-bridge estimator hover-controller flip-manager learner; do
        wait_for "healthy $service" healthy "$service"
        [ "$(inspect "$service" '{{.Image}}')" = "$simulated" ] || fail "$service is another image than in simulation"
    done
    [ -z "$(container director)" ] || fail "a director gives orders to hardware unasked"
    pass "the hardware profile: the same image, healthy, and nobody orders anything"
    compose down --timeout 5 >/dev/null 2>&1
}

start_engine
if [ $# -eq 0 ]; then build; fi
check_image
began="$SECONDS"
compose up --detach --no-build >/dev/null 2>&1 || fail "the arena does not come up"
wait_for "hovering vehicle" hovering
pass "hovering $((SECONDS - began)) s after \`up\`"
check_confinement
check_health
wait_for "completed flip" said director 'flip   0 completed'
pass "a flip was flown and measured"
for service in "${services[@]}"; do crash "$service"; done
for service in "${services[@]}"; do kill_and_start "$service"; done
simulated="$(inspect estimator '{{.Image}}')"
check_stop
recover
check_hall
check_replay
check_hardware
echo
echo "docker: $passed passed, 0 failed"
