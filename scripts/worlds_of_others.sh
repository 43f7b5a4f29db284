#!/usr/bin/env bash
# Four tasks that others have made, with their own simulators: failures, modes, RecoveryChaining with three seeds of
# 40,000 control steps each, its success, and a film of a failure beside its recovery. Forty minutes on two cores.
# Run it again after an interruption: finished trainings and evaluations are in results/thesis/records/, and what is under
# way goes on from its checkpoint in build/worlds_of_others/.
#
#   scripts/worlds_of_others.sh                  # all of it
#   WORLDS="fetch" scripts/worlds_of_others.sh   # one task, without the table
set -euo pipefail

root=$(git -C "$(dirname "${BASH_SOURCE[0]}")" rev-parse --show-toplevel)
cd "$root"
results=results/thesis build=build/worlds_of_others
read -ra worlds <<< "${WORLDS:-fetch drawer_open door_open stack}"
mkdir -p "$build" "$results/videos" "$results/tables"
run() { .venv/bin/python -m "stages.$1" --config-dir examples/conf experiment=thesis tracking=disabled "${@:2}"; }

for world in "${worlds[@]}"; do
  place=$build/$world
  found=(failures="$place/discover/failures_train.npz")
  [ -f "$place/discover/manifest.json" ] || [ -f "$place/discover/summary.json" ] ||
    run discover world="$world" executions.train=400 executions.held_out=150 records=null hydra.run.dir="$place/discover"
  run cluster world="$world" "${found[@]}" held_out="$place/discover/failures_held_out.npz" videos=false records=null \
    hydra.run.dir="$place/cluster"
  run chain_recoveries world="$world" "${found[@]}" 'compare=[rc]' 'seeds=[0,1,2]' budget=40000 evaluation.every=8000 \
    hydra.run.dir="$place/chains"
  run evaluate_chains world="$world" learnt="$place/chains" 'learners=[rc]' 'seeds=[0,1,2]' videos=false \
    transfer.failures=0 'reuse.learners=[]' hydra.run.dir="$place/judged"
  for failure in 0 1 2 3 4; do # the first that the policy recovers from
    told=$(run watch world="$world" "${found[@]}" failure=$failure policy="$place/chains/policies/rc/s0" hydra.run.dir="$place/film")
    echo "$told"
    cp "$place/film/$world-failure$failure-recovery.mp4" "$results/videos/$world.mp4"
    [[ $told != *"; recovered"* ]] || break
  done
done

[ -z "${WORLDS:-}" ] || exit 0
.venv/bin/python -m benchmarks.worlds_of_others "$build" "$results/tables/worlds_of_others.csv"
echo "the table is $results/tables/worlds_of_others.csv, films are $results/videos/{${worlds[*]}}.mp4"
