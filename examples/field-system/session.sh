#!/bin/sh
# Run a Field System against a simulated mount: its antenna program, a SNAP schedule, and its log on standard output.
#
# sh examples/field-system/session.sh        as oper; the README beside it says what must be there
set -eu
here=$(dirname "$0")
antenna=127.0.0.1:7621
name=overhead
PATH=/usr2/st/bin:/usr2/fs/bin:$PATH
export FS_DISPLAY_SERVER=off FS_ANTCN_TERMINATION=10

fail() {
    echo "session.sh: $1" >&2
    exit 1
}
# $1 seconds for the rest of the arguments, a command, to succeed.
until_it() {
    patience=$1
    shift
    until "$@" > /dev/null 2>&1; do
        patience=$((patience - 1))
        [ $patience -gt 0 ] || fail "waited in vain for: $*"
        sleep 1
    done
}

grep -q "^$antenna" /usr2/control/dev.ctl ||
    fail "the antenna of /usr2/control/dev.ctl is not $antenna: copy $here/control first"
! inject_snap -w log > /dev/null 2>&1 || fail "a Field System is running: end it first"

report=$(mktemp)
${SATTRACK:-sattrack} serve antenna --mount sim --axes azel --stow 180,60 --config "$here/../sattrack.toml" \
    < /dev/null > "$report" 2>&1 &
serving=$!
running=
ended() {
    [ -z "$running" ] || { inject_snap terminate > /dev/null; wait $running; } || true
    kill -INT $serving 2> /dev/null && wait $serving || true
    rm -f "$report"
}
trap ended EXIT
trap 'exit 1' INT TERM
until_it 60 grep -q "the mount is heard" "$report"

rm -f /usr2/log/$name.log
${PYTHON:-python} "$here/schedule.py" > /usr2/sched/$name.snp
(cd && exec fs -n) < /dev/null > /dev/null 2>&1 &
running=$!
until_it 60 inject_snap -w log
inject_snap "schedule=$name,#1"
until_it 180 grep -q "end of schedule" /usr2/log/$name.log
cat /usr2/log/$name.log
