#!/bin/bash
# cluster.sh up|down|node-up N|node-down N|controller-up|controller-down FOLDER
# A private Slurm of three nodes with two processors each, on the loopback address, without systemd or control groups; as
# root or as an ordinary user. Its settings, logs and process numbers are in FOLDER; it sees no other Slurm.
set -euo pipefail
action=$1 node=
case $action in node-*)
    node=$2
    shift
    ;;
esac
folder=$(realpath -m "$2")
host=$(hostname -s) user=$(id -un) nodes=3
export SLURM_CONF=$folder/slurm.conf PATH=$PATH:/usr/sbin

write_settings() {
    mkdir -p "$folder"/{controller,log,munge}
    chmod 755 "$folder"
    chmod 700 "$folder/munge"
    (umask 077 && head -c 1024 /dev/urandom >"$folder/munge/key")
    # cred_expire: how long a requeued task is held (below 5 it counts as 120 s). RequeueExit is not set, as at most sites.
    cat >"$SLURM_CONF" <<SETTINGS
ClusterName=private
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=16817
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
SlurmUser=$user
SlurmdUser=$user
AuthType=auth/munge
AuthInfo=socket=$folder/munge.sock,cred_expire=5
CredType=cred/munge
StateSaveLocation=$folder/controller
SlurmdSpoolDir=$folder/spool-%n
SlurmctldPidFile=$folder/controller.pid
SlurmdPidFile=$folder/node-%n.pid
SlurmctldLogFile=$folder/log/controller.log
SlurmdLogFile=$folder/log/node-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
ReturnToService=2
SchedulerParameters=sched_interval=2,sched_min_interval=0,bf_interval=2
MaxArraySize=${MAX_ARRAY_SIZE:-1001}
KillWait=2
SlurmdTimeout=5
MessageTimeout=5
BatchStartTimeout=5
SlurmdParameters=config_overrides
NodeName=n[1-$nodes] NodeHostname=$host NodeAddr=127.0.0.1 Port=[17001-$((17000 + nodes))] CPUs=2 RealMemory=4000 State=UNKNOWN
PartitionName=main Nodes=n[1-$nodes] Default=YES MaxTime=INFINITE State=UP
SETTINGS
}

end() { [ ! -s "$1" ] || kill "${2:--TERM}" "$(cat "$1")" 2>/dev/null || true; }

case $action in
up)
    write_settings
    munged --force --key-file="$folder/munge/key" --socket="$folder/munge.sock" --pid-file="$folder/munge/pid" \
        --log-file="$folder/munge/log" --seed-file="$folder/munge/seed" 2>"$folder/munge/warnings"
    slurmctld
    for i in $(seq $nodes); do slurmd -N "n$i"; done
    for _ in $(seq 100); do
        [ "$(sinfo -h -o '%D %T')" != "$nodes idle" ] || exit 0
        sleep 0.1
    done
    sinfo
    exit 1
    ;;
down)
    scancel -u "$user" 2>/dev/null || true
    scontrol shutdown 2>/dev/null || true
    sleep 0.5
    for pid in "$folder"/*.pid "$folder"/munge/pid; do end "$pid"; done
    ;;
# A node that is lost: its daemon and all it runs die without a word.
node-down)
    end "$folder/node-n$node.pid" -KILL
    tasks=() parents=()
    for environment in /proc/[0-9]*/environ; do
        text=$(tr '\0' '\n' 2>/dev/null <"$environment") || continue
        grep -qx "SLURMD_NODENAME=n$node" <<<"$text" || continue
        grep -qx "SLURM_CONF=$SLURM_CONF" <<<"$text" || continue
        task=$(basename "$(dirname "$environment")")
        # A process may end, and its parent too, while it is looked at.
        parent=$(awk '/^PPid:/ { print $2 }' "/proc/$task/status" 2>/dev/null) || continue
        tasks+=("$task")
        [ "$(cat "/proc/$parent/comm" 2>/dev/null)" != slurmstepd ] || parents+=("$parent")
    done
    # First those who would report the end of the others.
    [ ${#tasks[@]} -eq 0 ] || kill -KILL "${parents[@]}" "${tasks[@]}" 2>/dev/null || true
    ;;
node-up) slurmd -N "n$node" ;;
controller-down) end "$folder/controller.pid" -KILL ;;
controller-up) slurmctld ;;
esac
