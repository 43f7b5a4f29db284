#!/usr/bin/env bash
# Predictors of transfer at thesis scale, for insertion on the lattice and off it: pairs of tasks in the thesis's encoding
# and as walls, pre-trained skills predicted and measured in simulation, all on the same sets; then predictor_3.csv, its
# figure, and rows of the new predictor in figure_3_7.csv and figure_3_10_insertion.csv, whose other rows stay.
# Which encoding a domain has by itself is chosen on other seeds first: scripts/choose_predictor.py, predictor_choice.csv.
# Run it again after an interruption: what is simulated (<domain>-{collect,skills,pretrained,truth}-…) and fitted is in
# results/thesis/records/ as soon as it ends, and is not made again; plans and their costs follow in minutes.
#
#   scripts/thesis_predictor.sh                                # all of it
#   THREADS=1 DOMAINS=insertion scripts/thesis_predictor.sh    # a part, without tables; the rest can follow
set -euo pipefail

root=$(git -C "$(dirname "${BASH_SOURCE[0]}")" rev-parse --show-toplevel)
work=${1:-$root/build/predictor}
results=${RESULTS:-$root/results/thesis}
export PATH=$root/.venv/bin:$PATH PYTHONPATH=$root/src:$root
read -ra domains <<< "${DOMAINS:-insertion insertion_continuous}"
common=("experiment=${PRESET:-thesis}" tracking=disabled)
[ -z "${THREADS:-}" ] || common+=("++domain.params.nthread=$THREADS")
declare -A study=([insertion]=insertion_measured [insertion_continuous]=insertion_continuous)
declare -A draws=([predicted]=0)

# Costs of plans are quickly made anew; only what was simulated comes from the records, and goes there.
mkdir -p "$work/records" "$results/records"
keep() { find "$work/records" -name '*-truth-*' -exec cp -n {} "$results/records/" \;; }
trap keep EXIT

cd "$root"
for domain in "${domains[@]}"; do
  for seed in 101 102; do
    python -m stages.collect "${common[@]}" "domain=$domain" "seed=$seed" "records=$results/records" \
      "hydra.run.dir=$work/choice/$domain-s$seed"
  done
  data=$work/collect/$domain/transfer_data.npz
  python -m stages.collect "${common[@]}" "domain=$domain" "records=$results/records" \
    "hydra.run.dir=$work/collect/$domain"
  for encoding in difference walls; do
    of=("${common[@]}" "domain=$domain" "++domain.params.encoding=$encoding")
    fitted=$work/fit_transfer/$domain-$encoding
    python -m stages.fit_transfer "${of[@]}" "records=$results/records" "transfer_data=$data" "hydra.run.dir=$fitted"
    for skills in predicted measured; do
      item=$domain-$encoding-$skills
      measured=("study=${study[$domain]}")
      [ -z "${draws[$skills]:-}" ] || measured+=("++study.pretrained_draws=${draws[$skills]}")
      python -m stages.plan "${of[@]}" "${measured[@]}" "records=$results/records" "transfer_data=$data" \
        "transfer_model=$fitted/transfer_model.safetensors" "hydra.run.dir=$work/plan/$item"
      cp -n "$results/records/$domain-"{truth,skills}-*.json "$work/records/" 2> /dev/null || true
      python -m stages.evaluate_team "${of[@]}" "${measured[@]}" "records=$work/records" \
        "plans=$work/plan/$item/plans.parquet" "hydra.run.dir=$work/evaluate_team/$item"
    done
  done
  keep
done
if [ -n "${DOMAINS:-}" ]; then
  echo "this part's records are in $results/records; the tables come with a run of all parts, without DOMAINS"
  exit 0
fi
python scripts/choose_predictor.py "$work/choice" "$results"
python scripts/predictor_tables.py "$work" "$results"
