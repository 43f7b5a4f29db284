#!/usr/bin/env bash
# The ablation of section 5.4.2 at thesis scale, and ours, in the clone that scripts/thesis_chapter5.sh has left, on the
# shelf: RC with half and with double the noise, without history and number of actions, without episodes that start at
# earlier successes, and with the columns that `search` sees; `search` with those of the thesis; PP with preconditions
# from nominal runs alone, as the thesis has them; then ablation_5.csv.
# Run it again after an interruption: every finished run (shelf_<variant>-<learner>-s<seed>-b0.json, its policy in
# policies/) and every evaluation is in results/thesis/records/ as soon as it ends, and is not run again.
#
#   scripts/thesis_ablation.sh                               # all of it: 7 variants × 5 seeds
#   VARIANTS=rc:double SEEDS=0,1 scripts/thesis_ablation.sh  # a part; the rest can follow
#   THREADS=1 VARIANTS=rc:half scripts/thesis_ablation.sh build/one   # one simulator thread each, for two clones side by side
set -euo pipefail

root=$(git -C "$(dirname "${BASH_SOURCE[0]}")" rev-parse --show-toplevel)
clone=${1:-$root/build/thesis}
results=${RESULTS:-$root/results/thesis}
export PATH=$root/.venv/bin:$PATH
export MLFLOW_TRACKING_URI=${MLFLOW_TRACKING_URI:-$(cd "$root" && .venv/bin/python -c 'import pathlib, p2l.tracking; print(p2l.tracking.default_store(pathlib.Path()))')}
read -ra variants <<< "${VARIANTS:-rc:half rc:double rc:no_history rc:no_revisit rc:relative search:thesis_columns pp:no_failures}"
seen=grip_pos_m,grip_quat,gap_m,shelf_pos_m,object_pos_m,force_high,target_pos_m,target_quat,grip_command
declare -A sigma=([half]="[0.005,0.01]" [double]="[0.02,0.04]")
declare -A learning=(
  [no_history]="limits.history=1 limits.fields=[$seen]"
  [no_revisit]="revisit=0.0"
  [relative]='limits.history=${limits_of.search.history} limits.fields=${limits_of.search.fields}'
  [thesis_columns]='limits_of.search.history=${limits.history} limits_of.search.fields=${limits.fields}'
  [no_failures]="learners.pp.params.failures=0"
)

cd "$clone"
declare -A judged=()
common=(world=shelf "experiment=${PRESET:-thesis}")
[ -z "${THREADS:-}" ] || common+=("+world.params.nthread=$THREADS")
seeds="seeds=[${SEEDS:-0,1,2,3,4}]"
for pair in "${variants[@]}"; do
  learner=${pair%%:*} variant=${pair#*:}
  item=shelf_$variant differs=()
  [ -z "${sigma[$variant]:-}" ] || differs=("world.params.sigma_m=${sigma[$variant]}")
  [ -f "data/discover/$item/failures_train.npz" ] ||
    python -m stages.discover "${common[@]}" records=null "item=$item" "${differs[@]}" "hydra.run.dir=data/discover/$item"
  read -ra more <<< "${learning[$variant]:-}"
  python -m stages.chain_recoveries "${common[@]}" "item=$item" "${differs[@]}" "${more[@]}" "compare=[$learner]" "$seeds" \
    "hydra.run.dir=data/chain_recoveries/$item"
  judged[$learner]+="+ablation.variants.$variant={${sigma[$variant]:+sigma_m: ${sigma[$variant]}}}"$'\n'
done
for learner in "${!judged[@]}"; do
  mapfile -t mine <<< "${judged[$learner]%$'\n'}"
  python -m stages.evaluate_chains "${common[@]}" "learners=[$learner]" "ablation.learner=$learner" "$seeds" \
    transfer.failures=0 ceiling.macros=0 "${mine[@]}" "hydra.run.dir=data/evaluate_chains/shelf_ablation_$learner"
done
if [ -n "${VARIANTS:-}${SEEDS:-}" ]; then
  echo "this part's records are in $results/records; the table comes with a run of all parts, without VARIANTS and SEEDS"
  exit 0
fi
mkdir -p "$results/tables" "$results/metrics"
tables=()
for learner in rc search pp; do
  folder=data/evaluate_chains/shelf_ablation_$learner
  tables+=("$folder/ablation_5.csv")
  cp "$folder/summary.json" "$results/metrics/evaluate_chains-shelf_ablation_$learner-summary.json"
  { echo "# made at commit $(git rev-parse HEAD)"; cat "$folder/config.yaml"; } \
    > "$results/metrics/evaluate_chains-shelf_ablation_$learner-config.yaml"
done
{ head -n 1 "${tables[0]}"; for table in "${tables[@]}"; do tail -n +2 "$table"; done; } > "$results/tables/ablation_5.csv"
echo "ablation_5.csv is in $results/tables"
