#!/usr/bin/env bash
# The ablation of section 5.4.2 at thesis scale, in the clone that scripts/thesis_chapter5.sh has left: RC on the shelf
# with half and with double the noise, without history and number of actions, and without episodes that start at earlier
# successes; then ablation_5.csv.
# Run it again after an interruption: every finished run (shelf_<variant>-rc-s<seed>-b0.json, its policy in policies/)
# and every evaluation is in results/thesis/records/ as soon as it ends, and is not run again.
#
#   scripts/thesis_ablation.sh                            # all of it: 4 variants × 5 seeds
#   VARIANTS=double SEEDS=0,1 scripts/thesis_ablation.sh  # a part; the rest can follow
#   THREADS=1 VARIANTS=half scripts/thesis_ablation.sh build/one   # one simulator thread each, for two clones side by side
set -euo pipefail

root=$(git -C "$(dirname "${BASH_SOURCE[0]}")" rev-parse --show-toplevel)
clone=${1:-$root/build/thesis}
results=${RESULTS:-$root/results/thesis}
export PATH=$root/.venv/bin:$PATH
export MLFLOW_TRACKING_URI=${MLFLOW_TRACKING_URI:-$(cd "$root" && .venv/bin/python -c 'import pathlib, p2l.tracking; print(p2l.tracking.default_store(pathlib.Path()))')}
read -ra variants <<< "${VARIANTS:-half double no_history no_revisit}"
seen=grip_pos_m,grip_quat,gap_m,shelf_pos_m,object_pos_m,force_high,target_pos_m,target_quat,grip_command
declare -A sigma=([half]="[0.005,0.01]" [double]="[0.02,0.04]")
declare -A learning=([no_history]="limits.history=1 limits.fields=[$seen]" [no_revisit]="revisit=0.0")

cd "$clone"
judged=()
common=(world=shelf "experiment=${PRESET:-thesis}")
[ -z "${THREADS:-}" ] || common+=("+world.params.nthread=$THREADS")
seeds="seeds=[${SEEDS:-0,1,2,3,4}]"
for variant in "${variants[@]}"; do
  item=shelf_$variant differs=()
  [ -z "${sigma[$variant]:-}" ] || differs=("world.params.sigma_m=${sigma[$variant]}")
  [ -f "data/discover/$item/failures_train.npz" ] ||
    python -m stages.discover "${common[@]}" records=null "item=$item" "${differs[@]}" "hydra.run.dir=data/discover/$item"
  read -ra more <<< "${learning[$variant]:-}"
  python -m stages.chain_recoveries "${common[@]}" "item=$item" "${differs[@]}" "${more[@]}" "compare=[rc]" "$seeds" \
    "hydra.run.dir=data/chain_recoveries/$item"
  judged+=("+ablation.variants.$variant={${sigma[$variant]:+sigma_m: ${sigma[$variant]}}}")
done
python -m stages.evaluate_chains "${common[@]}" "learners=[rc]" "$seeds" transfer.failures=0 \
  "${judged[@]}" hydra.run.dir=data/evaluate_chains/shelf_ablation
if [ -n "${VARIANTS:-}${SEEDS:-}" ]; then
  echo "this part's records are in $results/records; the table comes with a run of all parts, without VARIANTS and SEEDS"
  exit 0
fi
mkdir -p "$results/tables" "$results/metrics"
cp data/evaluate_chains/shelf_ablation/ablation_5.csv "$results/tables/ablation_5.csv"
cp data/evaluate_chains/shelf_ablation/summary.json "$results/metrics/evaluate_chains-shelf_ablation-summary.json"
{ echo "# made at commit $(git rev-parse HEAD)"; cat data/evaluate_chains/shelf_ablation/config.yaml; } \
  > "$results/metrics/evaluate_chains-shelf_ablation-config.yaml"
echo "ablation_5.csv is in $results/tables"
