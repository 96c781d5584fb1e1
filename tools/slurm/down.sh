#!/bin/bash
# Ends what up.sh started in a folder: down.sh FOLDER.
for pid in "$1"/slurmd-*.pid "$1"/slurmctld.pid "$1"/munge/pid; do
    [ -f "$pid" ] && kill "$(cat "$pid")"
done
exit 0
