#!/usr/bin/env bash
# Chapter 4 at thesis scale: discover, cluster, preconditions, recoveries of every chooser and seed, tables and figures.
# Run it again after an interruption: the queries asked so far (<world>-ledger-s<seed>.npz) and the episodes run so far
# (<world>-<strategy>-s<seed>-b0.json) are in results/thesis/records/ as soon as each is finished; commit them, and the
# next machine goes on from there. An item that another configuration, or other failures, made is run anew.
set -euo pipefail

root=$(git -C "$(dirname "${BASH_SOURCE[0]}")" rev-parse --show-toplevel)
clone=${1:-$root/build/thesis}
results=$root/results/thesis
mkdir -p "$results/tables" "$results/figures" "$results/metrics"

TARGETS=evaluate_recoveries@door "$root/scripts/thesis.sh" "$clone"

for name in table_4_1 table_4_2 figure_4_6 figure_4_7; do
  cp "$clone/data/evaluate_recoveries/door/$name.csv" "$results/tables/$name.csv"
done
for name in figure_4_6 figure_4_7; do
  cp "$clone/data/evaluate_recoveries/door/$name.png" "$results/figures/$name.png"
done
for stage in discover cluster fit_preconditions learn_recoveries evaluate_recoveries; do
  cp "$clone/data/$stage/door/summary.json" "$results/metrics/$stage-door-summary.json"
done
echo "tables and figures of chapter 4 are in $results"
