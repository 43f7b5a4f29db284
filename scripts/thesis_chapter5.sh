#!/usr/bin/env bash
# Chapter 5 at thesis scale: three worlds, six learners, five seeds; then tables 5.1 and 5.2, figures 5.5, 5.8 and 5.9.
# Run it again after an interruption: every finished run (<world>-<learner>-s<seed>-b0.json, its policy in policies/) and
# every evaluation (<world>-<learner>_episodes-…, <world>-<learner>_to_<variant>-…, <world>-rc_reuse-…) is in results/thesis/records/ as soon
# as it ends; commit them, and the next machine goes on from there. A run under way goes on from its checkpoint here.
#
#   scripts/thesis_chapter5.sh                                   # all of it
#   WORLDS=pick_place LEARNERS=rc,pp SEEDS=0,1 scripts/thesis_chapter5.sh   # a part, without tables; the rest can follow
#   THREADS=1 WORLDS=shelf scripts/thesis_chapter5.sh build/one    # one simulator thread each lets two clones run side
#   THREADS=1 WORLDS=pick_place scripts/thesis_chapter5.sh build/two   # by side, faster than one after the other
set -euo pipefail

root=$(git -C "$(dirname "${BASH_SOURCE[0]}")" rev-parse --show-toplevel)
clone=${1:-$root/build/thesis}
results=$root/results/thesis
read -ra worlds <<< "${WORLDS:-pick_place shelf cluttered_shelf}"
mkdir -p "$results/tables" "$results/figures" "$results/metrics" "$results/videos"

learning=() judging=()
if [ -n "${LEARNERS:-}" ]; then
  learning+=("\"compare=[$LEARNERS]\"") judging+=("\"learners=[$LEARNERS]\"")
fi
if [ -n "${SEEDS:-}" ]; then
  learning+=("\"seeds=[$SEEDS]\"") judging+=("\"seeds=[$SEEDS]\"")
fi
if [ -n "${THREADS:-}" ]; then
  learning+=("\"+world.params.nthread=$THREADS\"") judging+=("\"+world.params.nthread=$THREADS\"")
fi
join() { local IFS=,; echo "$*"; }
TARGETS=$(printf 'evaluate_chains@%s ' "${worlds[@]}") \
  OVERRIDES="{chain_recoveries: [$(join "${learning[@]}")], evaluate_chains: [$(join "${judging[@]}")]}" \
  "$root/scripts/thesis.sh" "$clone"

if [ -n "${WORLDS:-}${LEARNERS:-}${SEEDS:-}" ]; then
  echo "this part's records are in $results/records; tables and figures come with a run of all parts, without WORLDS, LEARNERS and SEEDS"
  exit 0
fi
for name in table_5_1 table_5_2 figure_5_5 figure_5_8 figure_5_9 strategies_5 steps_to_thesis; do
  first=$clone/data/evaluate_chains/${worlds[0]}/$name.csv
  { head -n 1 "$first"; for world in "${worlds[@]}"; do tail -n +2 "$clone/data/evaluate_chains/$world/$name.csv"; done; } \
    > "$results/tables/$name.csv"
done
for world in "${worlds[@]}"; do
  for name in figure_5_5 figure_5_8 figure_5_9; do
    cp "$clone/data/evaluate_chains/$world/$name.png" "$results/figures/${name}_$world.png"
  done
  film=$clone/data/evaluate_chains/$world/videos/reuse.mp4
  [ ! -f "$film" ] || cp "$film" "$results/videos/reuse_$world.mp4"
  for stage in discover chain_recoveries evaluate_chains; do
    cp "$clone/data/$stage/$world/summary.json" "$results/metrics/$stage-$world-summary.json"
  done
done
{ echo "# made at commit $(git -C "$clone" rev-parse HEAD)"; cat "$clone/dvc.lock"; } > "$results/dvc-chapter5.lock"
"$root/.venv/bin/python" "$root/scripts/results_page.py"
echo "tables and figures of chapter 5 are in $results, policies with their cards in $results/records/policies"
