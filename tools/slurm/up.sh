#!/bin/bash
# Starts a Slurm of one machine on the loopback, for tests: up.sh FOLDER NODES. As root; Debian: slurm-wlm munge.
# State, keys and logs are in FOLDER, the configuration in FOLDER/slurm.conf (export SLURM_CONF). down.sh FOLDER ends it.
set -eu
folder=$1
nodes=$2
host=$(hostname -s)
getent hosts "$host" > /dev/null || echo "127.0.0.1 $host" >> /etc/hosts
mkdir -p "$folder"/{state,spool,log,munge}
chmod 755 "$folder"

# A key and a socket of its own; the daemon refuses to run as root.
[ -f "$folder/munge/munge.key" ] || dd if=/dev/urandom of="$folder/munge/munge.key" bs=1 count=1024 status=none
chown -R munge:munge "$folder/munge"
chmod 711 "$folder/munge"
chmod 600 "$folder/munge/munge.key"
runuser -u munge -- /usr/sbin/munged --force --key-file="$folder/munge/munge.key" --socket="$folder/munge/socket" \
    --pid-file="$folder/munge/pid" --log-file="$folder/munge/log" --seed-file="$folder/munge/seed"

# Ports below the range that systems give to clients, different for each process that starts one.
port=$((10000 + $$ % 20000))
memory=$(($(awk '/MemTotal/ { print $2 }' /proc/meminfo) / 1024 - 1024))
{
    cat << EOF
ClusterName=strandflow
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
# A job that was put back into the queue waits until its credentials have expired.
AuthInfo=socket=$folder/munge/socket,cred_expire=5
CredType=cred/munge
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
StateSaveLocation=$folder/state
SlurmctldPidFile=$folder/slurmctld.pid
SlurmctldLogFile=$folder/log/slurmctld.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
ReturnToService=2
# A node that does not answer is given up soon.
SlurmdTimeout=10
SchedulerType=sched/backfill
SchedulerParameters=sched_interval=1,sched_min_interval=0,batch_sched_delay=0,bf_interval=2
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
DefMemPerCPU=1000
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=1
JobAcctGatherParams=OverMemoryKill,UsePss
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/none
MailProg=/bin/true
KillWait=2
# A loaded machine may take long to end a job; a node that does is not to be drained.
UnkillableStepTimeout=180
MinJobAge=300
SlurmdPidFile=$folder/slurmd-%n.pid
SlurmdSpoolDir=$folder/spool/%n
SlurmdLogFile=$folder/log/slurmd-%n.log
EOF
    for i in $(seq 1 "$nodes"); do
        echo "NodeName=n$i NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + i)) CPUs=1 RealMemory=$((memory / nodes)) State=UNKNOWN"
    done
    echo "PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP OverSubscribe=NO"
} > "$folder/slurm.conf"
printf 'CgroupAutomount=no\nIgnoreSystemd=yes\n' > "$folder/cgroup.conf"
export SLURM_CONF=$folder/slurm.conf
/usr/sbin/slurmctld -f "$SLURM_CONF"
for i in $(seq 1 "$nodes"); do /usr/sbin/slurmd -f "$SLURM_CONF" -N "n$i"; done
for _ in $(seq 1 60); do
    [ "$(sinfo --noheader --Node --states=idle 2> /dev/null | wc -l)" -ge "$nodes" ] && exit 0
    sleep 0.5
done
sinfo --Node --long >&2
exit 1
