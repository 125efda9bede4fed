#!/bin/bash
# A training, which torchrun divides, on all GPUs of several machines:
#   sbatch examples/slurm/rans.sh train go-to-pose-2d --output runs/many --set ppo.n_envs=65536
# If it is cut short: sbatch examples/slurm/rans.sh train --resume runs/many. All machines must see the folder.
#SBATCH --job-name=rans
#SBATCH --nodes=2
#SBATCH --ntasks-per-node=1
#SBATCH --gpus-per-node=8
#SBATCH --cpus-per-task=64
#SBATCH --time=01:00:00
#SBATCH --signal=TERM@60

first=$(scontrol show hostnames "$SLURM_JOB_NODELIST" | head -n 1)
# After "--" no option of rans is taken for one of torchrun's.
srun torchrun --nnodes "$SLURM_NNODES" --nproc-per-node "$SLURM_GPUS_ON_NODE" \
  --rdzv-backend c10d --rdzv-id "$SLURM_JOB_ID" --rdzv-endpoint "$first:29500" -m -- rans "$@"
