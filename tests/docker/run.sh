#!/usr/bin/env bash
# The simulated arena in containers, for real: builds the image, brings the arena up, crashes and kills every service in
# hover, stops it, and reads in its recordings that no vehicle ever left the hall. Then a replay, and the same image as it
# would stand before hardware.
#
#     tests/docker/run.sh [IMAGE]
#
# Uses the Docker engine that runs, else starts one of its own (as root) and ends it. With IMAGE, nothing is built.
# COMPOSE names the Compose to use (default: docker-compose). If COMPOSE_SECOND names another, that one must accept the same
# files, brings the arena up once more, and runs the replay and the hardware. tests/docker/install.sh provides all this.
set -euo pipefail
here="$(cd "$(dirname "$0")/../.." && pwd)"
work="$(mktemp --directory)"
image="${1:-flyarena-test}"
builder=flyarena-test-builder
files=("$here/docker/compose.yaml" "$here/docker/compose.hardware.yaml" "$here/docker/compose.replay.yaml")
export FLYARENA_IMAGE="$image" FLYARENA_SCENARIO=double-flip FLYARENA_SEED=1 FLYARENA_RECORDING=test
export FLYARENA_VOLUME=flyarena-test-recordings
export FLYARENA_MOTION_CAPTURE=udp://127.0.0.1:51001 FLYARENA_DATA_LINK=udp://127.0.0.1:52000
export FLYARENA_COMMAND_LINK=udp://127.0.0.1:52100
# The builder without a cache of its own to clean up.
export DOCKER_BUILDKIT=0 COMPOSE_DOCKER_CLI_BUILD=0
services=(learner flip-manager logger vicon-bridge estimator hover-controller radio-bridge simulator director)
hardware=(logger vicon-bridge radio-bridge estimator hover-controller flip-manager learner)
# How long to wait before giving up; a healthy arena needs a small part of it.
patience_s=120
passed=0
watcher=

say() { printf '[%4d s] %s\n' "$SECONDS" "$*"; }
pass() { passed=$((passed + 1)); say "ok: $*"; }
fail() {
    say "FAILED: $*"
    compose logs --tail=30 2>&1 | tail -n 200 || true
    exit 1
}

# shellcheck source=tests/docker/engine.sh
. "$here/tests/docker/engine.sh"
# shellcheck source=tests/docker/watch.sh
. "$here/tests/docker/watch.sh"

# Of each arena, the files and the name of its project.
use() { export COMPOSE_FILE="$1" COMPOSE_PROJECT_NAME="$2"; }
simulated() { use "${files[0]}" flyarena-test; }
hovering_only() { use "${files[0]}:$here/tests/docker/hover.yaml" flyarena-test; }
before_hardware() { use "${files[1]}" flyarena-test-hardware; }
replayed() { use "${files[2]}" flyarena-test-replay; }

compose() { ${COMPOSE:-docker-compose} "$@"; }
# From here on, the other Compose, if there is one.
use_second() { if [ -n "${COMPOSE_SECOND:-}" ]; then COMPOSE="$COMPOSE_SECOND"; fi; }
# Compose takes a second for what the labels tell at once.
container() {
    docker ps --all --quiet --filter "label=com.docker.compose.project=$COMPOSE_PROJECT_NAME" \
        --filter "label=com.docker.compose.service=$1"
}
inspect() { docker inspect --format "$2" "$(container "$1")"; }
# The front door, in the container that holds no service and is never killed; for so many seconds at most.
arena() {
    timeout "$1" docker exec --env FLYARENA_SETTINGS_FILE=.flyarena/settings.toml "$(container run)" /arena "${@:2}"
}

# Takes everything back that an engine was given that goes on.
leave_engine() {
    local profile
    for profile in before_hardware replayed simulated; do
        "$profile"
        compose down --volumes --remove-orphans --timeout 2 >/dev/null 2>&1 || true
    done
    if [ "$image" != flyarena-test ]; then return 0; fi
    # Stages that were built, too: they have no names.
    { sed -n 's/^ ---> \([0-9a-f]\{12\}\)$/\1/p' "$work/build.log" 2>/dev/null | tac; echo "$image"; echo "$builder"; } \
        | xargs docker image rm >/dev/null 2>&1 || true
}

clean_up() {
    local code=$?
    trap '' INT TERM HUP
    if [ -n "$watcher" ]; then kill "$watcher" 2>/dev/null || true; fi
    if [ -n "$engine" ]; then
        # Networks, volumes and images go with it; for a container it would wait.
        docker ps --quiet | xargs --no-run-if-empty docker kill >/dev/null 2>&1 || true
    elif docker info >/dev/null 2>&1; then
        leave_engine
    fi
    end_engine
    rm --recursive --force "$work"
    exit "$code"
}
trap clean_up EXIT
trap 'exit 129' HUP
trap 'exit 130' INT
trap 'exit 143' TERM

# Waits until a command succeeds.
wait_for() {
    local what="$1" until=$((SECONDS + patience_s))
    shift
    until "$@"; do
        if [ "$SECONDS" -ge "$until" ]; then fail "waited ${patience_s} s for: $what"; fi
        sleep 0.2
    done
}

running() { [ "$(inspect "$1" '{{.State.Running}}')" = true ]; }
healthy() { [ "$(inspect "$1" '{{.State.Health.Status}}')" = healthy ]; }
said() { docker logs "$(container "$1")" 2>&1 | grep "$2" >/dev/null; }

check_files() {
    local file name
    for name in "${COMPOSE:-docker-compose}" ${COMPOSE_SECOND:+"$COMPOSE_SECOND"}; do
        for file in "${files[@]}"; do
            COMPOSE="$name" compose --file "$file" config --quiet || fail "$(basename "$file") is not accepted by $name"
        done
        pass "all three files are accepted by Compose $($name version --short)"
    done
}

build() {
    TMPDIR="$work" "$here/tests/docker/builder.sh" "$builder"
    say "the builder's image is there"
    compose build --build-arg BUILDER="$builder" run >"$work/build.log" 2>&1 \
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
    for service in "$@"; do
        found="$(inspect "$service" '{{.HostConfig.ReadonlyRootfs}} {{.HostConfig.CapDrop}} {{.HostConfig.CapAdd}} {{.HostConfig.SecurityOpt}} {{.Config.User}} {{.HostConfig.Privileged}}')"
        [ "$found" = 'true [ALL] [] [no-new-privileges:true] 65532:65532 false' ] || fail "$service runs as: $found"
    done
    pass "$COMPOSE_PROJECT_NAME: every container is read-only, without capabilities or new privileges, and not root's"
}

check_health() {
    local service
    for service in "$@"; do wait_for "healthy $service" healthy "$service"; done
    pass "$COMPOSE_PROJECT_NAME: every container says it is healthy"
}

bring_up() {
    local began="$SECONDS"
    compose up --detach --no-build >"$work/up.log" 2>&1 || { cat "$work/up.log"; fail "the arena does not come up"; }
    watch_truth
    wait_for "hovering vehicle" hovers_for 25
    pass "hovering $((SECONDS - began)) s after \`up\` with Compose $(compose version --short)"
    wait_for "completed flip" said director 'flip *[0-9]* completed'
    pass "a flip was flown and measured"
}

# Another director, which gives another order before the old one's is missed: the vehicle stays in the air.
direct() {
    docker kill "$(container director)" >/dev/null
    "$1"
    compose up --detach --no-build --no-deps director >/dev/null 2>&1 || fail "no other director comes up"
    from_now_on
}

# A process that dies comes back by itself.
crash() {
    local before
    before="$(inspect "$1" '{{.RestartCount}}')"
    kill -KILL "$(inspect "$1" '{{.State.Pid}}')"
    restarted() { running "$1" && [ "$(inspect "$1" '{{.RestartCount}}')" -gt "$before" ]; }
    wait_for "restart of $1" restarted "$1"
    from_now_on
    wait_for "hovering vehicle after $1 was restarted" hovers_for 100
    pass "$1 crashed in hover: restarted, and hovering again"
}

# A container that is killed stays away until somebody starts it again.
kill_and_start() {
    local outcome
    compose kill "$1" >/dev/null 2>&1
    from_now_on
    case "$1" in
        # Nobody needs them to hover. Four seconds are longer than any patience that would end it.
        learner | logger)
            wait_for "vehicle that hovers on without $1" hovers_for 200
            outcome="hovers on at $(place)"
            ;;
        simulator) outcome="there is no vehicle" ;;
        *)
            wait_for "vehicle that lands without $1" rests_for 50
            outcome="landed at $(place)"
            ;;
    esac
    compose start "$1" >/dev/null 2>&1
    from_now_on
    wait_for "hovering vehicle after $1 came back" hovers_for 100
    pass "$1 killed in hover: $outcome; hovering again once it was back"
}

# What each program announces as the digest of its file, `node digest` a line; all of these must.
digests() {
    local domain="$1" node
    shift
    arena "$patience_s" echo node/health --json --count 30 --domain "$domain" >"$work/health" \
        || fail "no account of health in $COMPOSE_PROJECT_NAME"
    sed -n 's/.*"node":"\([a-z-]*\)".*"program_digest":\([0-9]*\).*/\1 \2/p' "$work/health" | sort --unique >"$work/found"
    for node in "$@"; do
        grep --quiet "^$node [1-9][0-9]*$" "$work/found" \
            || { cat "$work/found"; fail "$node does not announce its program's digest in $COMPOSE_PROJECT_NAME"; }
    done
}

# The same files in the simulated and in the hardware profile: what each announced, and the file in the image itself.
compare_digests() {
    local service file_digest
    docker cp "$(container estimator)":/arena "$work/arena" >/dev/null
    file_digest="$((16#$(xxhsum -H3 - <"$work/arena" | sed 's/.* = //')))"
    file_digest="$(printf '%u' "$file_digest")"
    for service in "${hardware[@]}"; do
        [ "$(grep "^$service " "$work/simulated")" = "$(grep "^$service " "$work/hardware")" ] \
            || fail "$service is another program before hardware: $(grep --no-filename "^$service " "$work/simulated" "$work/hardware")"
    done
    if grep --invert-match --quiet " $file_digest$" "$work/simulated" "$work/hardware"; then
        cat "$work/simulated"
        fail "what is announced is not the digest of the image's file, $file_digest"
    fi
    pass "each of $(wc --lines <"$work/simulated") programs in simulation, $(wc --lines <"$work/hardware") before hardware announces the image's file, $file_digest"
}

# The recordings, on this machine. Those that nobody sealed are whose logger was killed: two, and they are recovered.
check_stop() {
    compose stop >/dev/null 2>&1
    said director '^landed$' || fail "the director did not land: $(docker logs --tail 3 "$(container director)" 2>&1)"
    pass "stopped: landed first"
    docker cp "$(container logger)":/flyarena/recordings/. "$work/recordings" >/dev/null
    if [ ! -e "$work/recordings/$1.mcap" ] || [ -e "$work/recordings/$1.mcap.part" ]; then
        ls -l "$work/recordings"
        fail "$1.mcap is not sealed"
    fi
    on_recordings export "recordings/$1.mcap" --csv --topic plant/truth >"$work/truth.csv" \
        || fail "$1.mcap cannot be read"
    [ "$(positions <"$work/truth.csv" | tail -n 1 | awk '{ print ($3 < 0.1) }')" = 1 ] \
        || fail "the recording ends before the landing, at ($(positions <"$work/truth.csv" | tail -n 1))"
    pass "$1.mcap is sealed, and ends with the vehicle on the floor"
}

# The front door, on the recordings.
on_recordings() {
    docker run --rm --network none --user 0:0 --cap-drop ALL --volume "$work/recordings:/flyarena/recordings" "$image" "$@"
}

recover() {
    local part count=0
    for part in "$work"/recordings/*.part; do
        on_recordings recover "recordings/$(basename "$part")" >"$work/recovered.log" 2>&1 \
            || { cat "$work/recovered.log"; fail "$(basename "$part") cannot be recovered"; }
        count=$((count + 1))
    done
    [ "$count" -eq 2 ] || { ls -l "$work/recordings"; fail "$count recordings are torn, not the two whose logger was killed"; }
    pass "two recordings whose logger was killed are whole again"
}

# Where the vehicle truly was, from every recording, and from what was heard all along.
check_hall() {
    local recording total=0
    for recording in "$work"/recordings/*.mcap; do
        case "$recording" in *.[0-9][0-9][0-9][0-9].mcap) continue ;; esac
        on_recordings export "recordings/$(basename "$recording")" --csv --topic plant/truth >"$work/truth.csv" 2>"$work/said" \
            || say "$(basename "$recording"): $(tail -n 1 "$work/said")"
        positions <"$work/truth.csv" >"$work/positions"
        check_inside "$(basename "$recording")"
        total=$((total + $(wc --lines <"$work/positions")))
    done
    heard >"$work/positions"
    check_inside "what was heard"
    pass "$total recorded true states and $(wc --lines <"$work/positions") heard, all in the hall"
}

# The recording, put back on a bus of its own: the services take it as live data.
check_replay() {
    replayed
    FLYARENA_RECORDING=test-3 compose up --detach --no-build >"$work/up.log" 2>&1 \
        || { cat "$work/up.log"; fail "the replay does not come up"; }
    tracks() {
        timeout 20 docker exec "$(container estimator)" /arena echo vehicle/state --count 1 --json --domain replay --run 1 \
            | grep '"tracking":"TRACKING"' >/dev/null
    }
    wait_for "estimator that tracks in the replay" tracks
    check_confinement run playback vicon-bridge radio-bridge estimator hover-controller flip-manager learner
    pass "a replay: the estimator tracks"
    compose down --timeout 5 >/dev/null 2>&1
}

# The same image before equipment that is not there: every program runs and nobody orders anything.
check_hardware() {
    local service ordered
    before_hardware
    for service in run "${hardware[@]}"; do
        [ "$(inspect "$service" '{{.Image}}')" = "$flown" ] || fail "$service is another image than in simulation"
    done
    check_confinement run "${hardware[@]}"
    check_health run "${hardware[@]}"
    digests live "${hardware[@]}"
    mv "$work/found" "$work/hardware"
    compare_digests
    [ -z "$(container director)" ] || fail "a director gives orders to hardware unasked"
    ordered="$(arena 3 echo arena/order --count 1 --json --domain live || true)"
    [ -z "$ordered" ] || fail "somebody orders: $ordered"
    pass "the hardware profile: the same image, healthy, and nobody orders anything"
}

start_engine "$work/engine"
simulated
check_files
if [ $# -eq 0 ]; then build; fi
check_image
bring_up
flown="$(inspect estimator '{{.Image}}')"
check_confinement run "${services[@]}"
check_health run "${services[@]}"
digests sim "${services[@]/director/arena}"
mv "$work/found" "$work/simulated"
direct hovering_only
wait_for "hovering vehicle" hovers_for 100
for service in "${services[@]}"; do crash "$service"; done
for service in "${services[@]}"; do kill_and_start "$service"; done
direct simulated
wait_for "completed flip" said director 'flip *[0-9]* completed'
pass "learning goes on"
check_stop test-3
compose down >/dev/null 2>&1
use_second
bring_up
check_stop test-4
recover
check_hall
before_hardware
compose up --detach --no-build >"$work/up.log" 2>&1 || { cat "$work/up.log"; fail "the hardware profile does not come up"; }
check_replay
check_hardware
echo
echo "docker: $passed passed, 0 failed"
