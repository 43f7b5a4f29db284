#!/usr/bin/env bash
# The thesis preset, in a clone under build/, so that the working tree keeps its own preset and dvc.lock.
# Run it again after an interruption or after new commits: DVC continues where it stopped, and finished items, which
# land in results/thesis/ of this repository, are not run again, here or on the next machine.
# TARGETS names DVC stages to stop at, such as evaluate_recoveries@door; then the report's tables stay as they are.
# OVERRIDES is the line of that name in conf/pipeline.yaml, for a part of the runs: {chain_recoveries: ["seeds=[0]"]}.
set -euo pipefail
shopt -s nullglob

root=$(git -C "$(dirname "${BASH_SOURCE[0]}")" rev-parse --show-toplevel)
clone=${1:-$root/build/thesis}
export PATH=$root/.venv/bin:$PATH
export MLFLOW_TRACKING_URI=${MLFLOW_TRACKING_URI:-$(cd "$root" && .venv/bin/python -c 'import pathlib, p2l.tracking; print(p2l.tracking.default_store(pathlib.Path()))')}

# What is here is checked out anew and partly deleted, so it must be a clone that this script made.
if [ -e "$clone/.git" ]; then
  [ -e "$clone/.git/thesis-head" ] || { echo "$0: $clone is a repository, and this script did not make it; name another folder" >&2; exit 2; }
elif [ -e "$clone" ] && [ -n "$(ls -A "$clone")" ]; then
  echo "$0: $clone holds files, and this script did not put them there; name an empty folder, or a new one" >&2
  exit 2
else
  git clone --quiet "$root" "$clone.part.$$"
  touch "$clone.part.$$/.git/thesis-head"
  [ ! -d "$clone" ] || rmdir "$clone"
  mv "$clone.part.$$" "$clone"
fi
head=$(git -C "$root" rev-parse HEAD)
if [ "$(cat "$clone/.git/thesis-head" 2> /dev/null || true)" != "$head" ]; then
  [ -f "$clone/dvc.lock" ] && cp "$clone/dvc.lock" "$clone/.git/thesis-lock"
  rm -rf "$clone/results/thesis"
  git -C "$clone" fetch --quiet origin
  git -C "$clone" checkout --quiet --force --detach "$head"
  sed -i -e 's/^preset: [a-z]*/preset: thesis/' \
    -e 's/^  - door$/&\n  - door_early\n  - door_real\n  - door_blurred\n  - nut/' \
    -e 's/^chain_worlds: \[.*\]/chain_worlds: [pick_place, shelf, cluttered_shelf]/' "$clone/conf/pipeline.yaml"
  [ -f "$clone/.git/thesis-lock" ] && cp "$clone/.git/thesis-lock" "$clone/dvc.lock"
  mkdir -p "$root/results/thesis" "$clone/results"
  rm -rf "$clone/results/thesis"
  ln -s "$root/results/thesis" "$clone/results/thesis"
  (cd "$clone" && dvc cache dir --local "$root/.dvc/cache")
  echo "$head" > "$clone/.git/thesis-head"
fi

cd "$clone"
none='{}'
sed -i "s|^overrides: .*|overrides: ${OVERRIDES:-$none}|" conf/pipeline.yaml
read -ra targets <<< "${TARGETS:-}"
dvc repro "${targets[@]}"
[ ${#targets[@]} -eq 0 ] || exit 0

results=$root/results/thesis
declare -A further # rows that scripts/thesis_predictor.sh has put below ours
for name in figure_3_7 figure_3_10_insertion; do
  further[$name]=$(grep -h 'predictor=' "$results/tables/$name.csv" || true)
done
for part in tables figures; do
  mkdir -p "$results/$part"
  cp -r "data/report/$part/." "$results/$part" # what other scripts made, such as the ablation's table, stays
done
for name in "${!further[@]}"; do
  [ -z "${further[$name]}" ] || printf '%s\n' "${further[$name]}" >> "$results/tables/$name.csv"
done
mkdir -p "$results/metrics"
for file in data/*/*/{metrics,summary}.json; do
  item=${file#data/}
  cp "$file" "$results/metrics/$(dirname "$item" | tr / -)-$(basename "$file")"
done
cp dvc.lock "$results/dvc.lock"
cp data/report/metrics.json "$results/metrics/report.json"
"$root/.venv/bin/python" "$root/scripts/results_page.py"
echo "results of the thesis preset are in $results"
