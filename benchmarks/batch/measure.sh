#!/bin/bash
# measure.sh PROGRAM [--quick]: what a batch costs besides its points, as a table in CSV.
#   efficiency       points of 10 ms: processor time of the points over two processors' time of the whole run
#   overhead         empty points on one worker: time of the run over their number
#   million          a million empty points planned, run and merged, each process within MEMORY_KIB of address space
set -euo pipefail
tribode=$(realpath "$1")
[ "${2:-}" = --quick ] && factor=100 || factor=1
readonly MEMORY_KIB=1000000
folder=$(mktemp -d)
trap 'rm -r "$folder"' EXIT
cd "$folder"

cat >points.lua <<'SCRIPT'
local tb = require "tribode"
local options = tb.options { count = 100, seconds = 0 }
tb.batch {
    name = "cost of a batch", seed = 1, count = options.count,
    points = function(index) return { x = index } end,
    run = function(point)
        local until_ = os.clock() + options.seconds
        while os.clock() < until_ do end
        return { y = 2 * point.x }
    end,
}
SCRIPT

plan() { "$tribode" batch plan points.lua -o "$1" -D count="$2" -D seconds="$3" --quiet; }

# Wall time in seconds of a command.
seconds() {
    local begin=$EPOCHREALTIME
    "$@"
    awk -v a="$begin" -v b="$EPOCHREALTIME" 'BEGIN { print b - a }'
}

row() { awk -v what="$1" -v value="$2" -v unit="$3" 'BEGIN { printf "%s,%.4g,%s\n", what, value, unit }'; }

echo "quantity,value,unit"

count=$((4000 / factor))
plan efficiency $count 0.01
taken=$(seconds "$tribode" batch run efficiency -j 2 --quiet)
row "efficiency of 2 workers at points of 10 ms" "$(awk "BEGIN { print $count * 0.01 / 2 / $taken }")" 1

count=$((200000 / factor))
plan overhead $count 0
taken=$(seconds "$tribode" batch run overhead -j 1 --quiet)
row "overhead of a point" "$(awk "BEGIN { print 1e6 * $taken / $count }")" us

count=$((1000000 / factor))
ulimit -v $MEMORY_KIB
row "plan of $count points" "$(seconds plan million $count 0)" s
row "run of $count points" "$(seconds "$tribode" batch run million -j 2 --quiet)" s
row "merge of $count points" "$(seconds "$tribode" batch merge million -o million.h5 --quiet)" s
row "address space allowed to each process" "$(awk "BEGIN { print $MEMORY_KIB / 1024 }")" MiB
