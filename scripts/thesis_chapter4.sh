#!/usr/bin/env bash
# Chapter 4 at thesis scale, twice: `door`, from pessimistic failures (tables 4.1 and 4.2), and `door_early`, from
# failures by early termination and with every chooser (figures 4.6 and 4.7).
# Run it again after an interruption: the queries asked so far (<world>-ledger-s<seed>.npz) and the episodes run so far
# (<world>-<strategy>-s<seed>-b0.json) are in results/thesis/records/ as soon as each is finished; commit them, and the
# next machine goes on from there. An item that another configuration, or other failures, made is run anew.
set -euo pipefail

root=$(git -C "$(dirname "${BASH_SOURCE[0]}")" rev-parse --show-toplevel)
clone=${1:-$root/build/thesis}
results=$root/results/thesis
mkdir -p "$results/tables" "$results/figures" "$results/metrics"

TARGETS="evaluate_recoveries@door evaluate_recoveries@door_early" "$root/scripts/thesis.sh" "$clone"

for name in table_4_1 table_4_2; do
  cp "$clone/data/evaluate_recoveries/door/$name.csv" "$results/tables/$name.csv"
done
for name in figure_4_6 figure_4_7; do
  cp "$clone/data/evaluate_recoveries/door_early/$name.csv" "$results/tables/$name.csv"
  cp "$clone/data/evaluate_recoveries/door_early/$name.png" "$results/figures/$name.png"
done
cp "$clone/data/learn_recoveries/door_early/choosers.csv" "$results/tables/choosers.csv"
for item in door door_early; do
  for stage in discover cluster fit_preconditions learn_recoveries evaluate_recoveries; do
    cp "$clone/data/$stage/$item/summary.json" "$results/metrics/$stage-$item-summary.json"
  done
done
{ echo "# made at commit $(git -C "$clone" rev-parse HEAD)"; cat "$clone/dvc.lock"; } > "$results/dvc-chapter4.lock"
echo "tables and figures of chapter 4 are in $results"
