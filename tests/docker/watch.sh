# shellcheck shell=bash disable=SC2154
# Where the vehicle truly is, as the simulator says on the bus. To be sourced by tests/docker/run.sh.
#
# One listener stays for as long as the arena is up. What is asked of it is asked in true states, 50 a second, so that a
# slow machine makes nothing of it untrue.

# Where the scenario's vehicle hovers, and how far off it may be.
hover_z_m=5
hover_error_m=0.5

# Starts to listen.
watch_truth() {
    if [ -n "$watcher" ]; then kill "$watcher" 2>/dev/null || true; fi
    : >>"$work/truth"
    docker exec --env FLYARENA_SETTINGS_FILE=.flyarena/settings.toml "$(container run)" \
        /arena echo plant/truth --json >>"$work/truth" 2>>"$work/truth.log" &
    watcher=$!
    from_now_on
}

# What the questions below are about: what was heard since this was called last.
since=0
from_now_on() { since="$(heard | wc --lines)"; }

# x, y and z in metres of each state heard, a line each.
heard() {
    sed -n 's/.*"position_m":{"x":\([^,}]*\),"y":\([^,}]*\),"z":\([^,}]*\)}.*/\1 \2 \3/p' "$work/truth"
}
# Of what was heard since, the newest states, so many at most.
news() { heard | tail -n "+$((since + 1))" | tail -n "$1"; }

# The newest place.
place() { news 1 | awk '{ printf "(%.2f, %.2f, %.2f) m", $1, $2, $3 }'; }

# Whether the newest states, so many of them, are all at the hover's place.
hovers_for() {
    news "$1" | awk -v count="$1" -v z="$hover_z_m" -v error="$hover_error_m" '
        sqrt($1 ^ 2 + $2 ^ 2 + ($3 - z) ^ 2) > error { away = 1 }
        END { exit !(NR == count && !away) }'
}

# Whether the newest states, so many of them, are all one place on the floor.
rests_for() {
    news "$1" | awk -v count="$1" '
        NR == 1 { x = $1; y = $2 }
        $3 > 0.1 || ($1 - x) ^ 2 + ($2 - y) ^ 2 > 0.01 { moves = 1 }
        END { exit !(NR == count && !moves) }'
}

# The same of a recording's table.
positions() {
    awk -F, 'NR == 1 { for (i = 1; i <= NF; i++) for (axis in at) if (index($i, "truth.position_m." axis) == 1) at[axis] = i
                       next }
        { print $at["x"], $at["y"], $at["z"] }
        BEGIN { at["x"]; at["y"]; at["z"] }'
}

# Whether every place in $work/positions lies in the hall, 10 m wide, deep and high, with the floor at zero.
check_inside() {
    local states outside
    states="$(wc --lines <"$work/positions")"
    outside="$(awk '!(NF == 3 && $1 ^ 2 <= 25 && $2 ^ 2 <= 25 && $3 >= -0.1 && $3 <= 10)' "$work/positions")"
    [ "$states" -gt 100 ] || fail "$1 does not tell where the vehicle was: $states true states"
    [ -z "$outside" ] || fail "$1: of $states true states these lie outside the hall: $(head -n 5 <<<"$outside")"
    say "$1: $states true states"
}
