#!/bin/bash
# run.sh PROGRAM: a batch on a Slurm of three nodes, under what may happen to it: a task is killed, a node is lost, the
# controller forgets the array. Each time the merged file must be, byte for byte, that of a run without a cluster.
set -euo pipefail
cluster=$(realpath "$(dirname "${BASH_SOURCE[0]}")/cluster.sh") tribode=$(realpath "$1")
folder=$(mktemp -d)
export SLURM_CONF=$folder/cluster/slurm.conf
# Arrays of four tasks, so that a batch needs several.
export MAX_ARRAY_SIZE=5
trap '"$cluster" down "$folder/cluster"; rm -rf "$folder"' EXIT
cd "$folder"

cat >points.lua <<'SCRIPT'
local tb = require "tribode"
return tb.batch {
    name = "on a cluster", seed = 7, count = 90,
    points = function(i) return { x = i / 10 } end,
    run = function(point, seed)
        local until_ = os.clock() + 0.05
        repeat until os.clock() > until_
        return { square = point.x ^ 2, seed = seed }
    end,
}
SCRIPT

fail() {
    echo "FAILED: $1" >&2
    tail -n 20 cluster/log/controller.log ./*/slurm/*.log >&2 || true
    exit 1
}

# value FOLDER KEY: of the status of a batch; two spaces, since keys inside other values have names of their own.
value() { "$tribode" batch status "$1" --json | sed -n "s/^  \"$2\": \([0-9a-z]*\),*$/\1/p"; }

# until_done FOLDER POINTS: waits until so many points are done; the files say it, not the queue.
until_done() {
    for _ in $(seq 600); do
        [ "$(value "$1" "done")" -lt "$2" ] || return 0
        sleep 0.2
    done
    fail "$1: only $(value "$1" "done") points are done"
}

until_complete() {
    for _ in $(seq 600); do
        [ "$(value "$1" complete)" != true ] || return 0
        sleep 0.2
    done
    fail "$1: $(value "$1" "done") points are done"
}

# The numbers of the processes that run shards of a batch.
tasks_of() { pgrep -f "$tribode batch shard $folder/$1 " || true; }

plan() { "$tribode" batch plan points.lua -o "$1" --shards 9 --quiet; }

check() {
    "$tribode" batch merge "$1" -o "$1.h5" --quiet
    cmp "$1.h5" undisturbed.h5 || fail "$1: the merged file differs"
    echo "   as without a cluster: $1"
}

plan undisturbed
"$tribode" batch run undisturbed -j 2 --quiet
"$tribode" batch merge undisturbed -o undisturbed.h5 --quiet
"$cluster" up "$folder/cluster" || {
    echo "left out: no Slurm can be started on this machine"
    exit 0
}

plan killed_task
"$tribode" batch slurm killed_task --quiet
until_done killed_task 10
# One task may have ended and the next not yet begun, or end before it is killed.
for _ in $(seq 100); do
    victim=$(tasks_of killed_task | head -n 1)
    [ -z "$victim" ] || ! kill -KILL "$victim" 2>/dev/null || break
    victim=
    sleep 0.05
done
[ -n "$victim" ] || fail "killed_task: no task is running, $(value killed_task "done") points are done"
until_complete killed_task # without any further command: the task asked to be started again
check killed_task

plan lost_node
"$tribode" batch slurm lost_node --quiet
until_done lost_node 10
"$cluster" node-down 2 "$folder/cluster"
until_complete lost_node
check lost_node
"$cluster" node-up 2 "$folder/cluster"

plan forgotten_array
"$tribode" batch slurm forgotten_array --quiet
until_done forgotten_array 10
"$cluster" controller-down "$folder/cluster"
# What it knew of jobs is lost with it.
rm -rf "$folder"/cluster/controller/*
for process in $(tasks_of forgotten_array); do kill -KILL "$process" 2>/dev/null || true; done
"$cluster" controller-up "$folder/cluster"
for _ in $(seq 100); do
    sinfo -h >/dev/null 2>&1 && break
    sleep 0.2
done
[ "$(value forgotten_array complete)" = false ] || fail "the batch was complete before the controller was"
"$tribode" batch slurm forgotten_array --quiet
until_complete forgotten_array
check forgotten_array
echo "passed in $SECONDS s"
