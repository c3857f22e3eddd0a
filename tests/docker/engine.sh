# shellcheck shell=bash
# The Docker engine of tests/docker/run.sh: the one that runs, else one of our own. To be sourced.
#
# Our own has network, mounts and firewall of its own, in namespaces that end with it: whatever happens to the test, none
# of them stays behind on this machine, and nothing of this machine's is touched.

# The process of our own engine, if there is one.
engine=
engine_folder=

# Starts an engine in a folder, unless one runs.
start_engine() {
    if docker info >/dev/null 2>&1; then return; fi
    say "no engine runs: starting one"
    engine_folder="$1"
    mkdir --parents "$engine_folder"
    export DOCKER_HOST="unix://$engine_folder/docker.sock"
    # In a session of its own: Ctrl-C is for the test, which ends the engine last. No network but those that the test
    # makes, and nothing is forwarded.
    setsid unshare --net --mount --propagation private sh -c 'ip link set lo up && exec "$@"' engine \
        dockerd --host "$DOCKER_HOST" --data-root "$engine_folder/data" --exec-root "$engine_folder/exec" \
        --pidfile "$engine_folder/pid" --cgroup-parent "$(cgroup)" --exec-opt native.cgroupdriver=cgroupfs \
        --bridge none --ip-forward=false --ip-masq=false >"$engine_folder/log" 2>&1 &
    engine=$!
    for _ in $(seq 120); do
        if docker info >/dev/null 2>&1; then return; fi
        if ! kill -0 "$engine" 2>/dev/null; then break; fi
        sleep 0.5
    done
    tail -n 30 "$engine_folder/log"
    say "FAILED: no engine could be started"
    exit 1
}

# The control group of our own engine's containers.
cgroup() { echo "/flyarena-test-$$"; }

# Ends our own engine, and removes what only an engine of that name could have left.
end_engine() {
    # In a trap, the status of a bare `return` is not its own.
    if [ -z "$engine" ]; then return 0; fi
    kill "$engine" 2>/dev/null || true
    wait "$engine" 2>/dev/null || true
    rmdir "/sys/fs/cgroup$(cgroup)" "/sys/fs/cgroup/"*"$(cgroup)" 2>/dev/null || true
    rm --recursive --force "$engine_folder"
}
