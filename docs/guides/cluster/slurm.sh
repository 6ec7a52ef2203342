#!/usr/bin/env bash
#SBATCH --job-name=busybot
#SBATCH --nodes=4
#SBATCH --ntasks-per-node=1
#SBATCH --cpus-per-task=16
#SBATCH --time=04:00:00
#SBATCH --no-kill
# Records a dataset on all nodes of the job: sbatch slurm.sh DATASET [OPTION OF busybot collect]...
# busybot, with its extra `cluster`, and DATASET are on a file system that all nodes share; `.venv/bin` is in PATH.
# Nobody without the token, which is made for this job, may run anything on its nodes.
set -euo pipefail
: "${1:?usage: sbatch slurm.sh DATASET [OPTION]...}"
export RAY_USAGE_STATS_ENABLED=0 RAY_AUTH_MODE=token
RAY_AUTH_TOKEN=$(head -c 32 /dev/urandom | sha256sum | cut -d' ' -f1)
export RAY_AUTH_TOKEN
trap 'kill $(jobs -p) 2> /dev/null || true' EXIT

mapfile -t nodes < <(scontrol show hostnames "$SLURM_JOB_NODELIST")
ip=$(srun --nodes=1 --ntasks=1 --nodelist="${nodes[0]}" hostname --ip-address | cut -d' ' -f1)
address=$ip:${RAY_PORT:-6379}

srun --overlap --nodes=1 --ntasks=1 --nodelist="${nodes[0]}" \
    ray start --head --node-ip-address="$ip" --port="${address#*:}" --num-cpus="$SLURM_CPUS_PER_TASK" \
    --include-dashboard=false --block &
timeout 120 bash -c "until ray status --address=$address > /dev/null 2>&1; do sleep 2; done" || {
    echo "Ray does not answer at $address" >&2
    exit 1
}
if [ "$SLURM_NNODES" -gt 1 ]; then
    srun --overlap --no-kill --nodes=$((SLURM_NNODES - 1)) --ntasks=$((SLURM_NNODES - 1)) --exclude="${nodes[0]}" \
        ray start --address="$address" --num-cpus="$SLURM_CPUS_PER_TASK" --block &
fi

RAY_ADDRESS=$address busybot collect "$@" --engine ray --workers $((SLURM_NNODES * SLURM_CPUS_PER_TASK))
