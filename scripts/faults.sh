#!/usr/bin/env bash
# The faults that this project has met, each provoked again with the real parts; a line each, and the log of what failed.
#
#   scripts/faults.sh             # all of them, in about five minutes
#   scripts/faults.sh kill sweep  # those whose line holds one of these words
set -uo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root" || exit 2
log=$(mktemp -d)
failed=0

# Ten kills of every stage with checkpoints, records or files for other machines take a quarter of an hour more:
#   .venv/bin/python -m pytest -m slow tests/stages/test_kills.py

try() { # what goes wrong, then how pytest is asked for it
  local title=$1 word
  shift
  if [ ${#words[@]} -gt 0 ]; then
    local chosen=no
    for word in "${words[@]}"; do [[ $title != *"$word"* ]] || chosen=yes; done
    [ "$chosen" = yes ] || return 0
  fi
  local began=$SECONDS
  if .venv/bin/python -m pytest -q "$@" > "$log/log" 2>&1; then
    printf 'pass  %-52s %4d s\n' "$title" $((SECONDS - began))
  else
    printf 'FAIL  %-52s %4d s\n' "$title" $((SECONDS - began))
    tail -n 40 "$log/log"
    failed=$((failed + 1))
  fi
}

words=("$@")
busy=()
load() { # two processes that do nothing but work, as on a shared machine
  for _ in 1 2; do .venv/bin/python -c 'while True: pass' & busy+=($!); done
}
trap '[ ${#busy[@]} -eq 0 ] || kill "${busy[@]}" 2> /dev/null; rm -rf "$log"' EXIT

try "kill in a stage"                         tests/stages/test_chain_stages.py -k "killed_training or stop_is_two" tests/stages/test_stage.py
try "kill in the write of a checkpoint"       tests/test_artifacts.py -k "killed"
try "kill, resume, kill, resume: to the bit"  tests/chaining/test_ppo.py -k "to_the_bit"
try "configuration changed under a checkpoint" tests/stages/test_chain_stages.py tests/chaining/test_ppo.py -k "another_configuration"
try "truncated artifact of every kind"        tests/test_artifacts.py tests/team/test_files.py -k "half or tampered"
try "corrupted cache: a flipped byte"         tests/test_artifacts.py -k "flipped"
try "NaN into solvers"                        tests/team/test_solve.py tests/team/test_location.py tests/team/test_problem.py -k "nan or NaN or refuses or refused or bad_input"
try "numbers that mean never, at every scale" tests/team/test_planners.py tests/team/test_location.py -k "scale or never or million"
try "time-outs"                               tests/team/test_planners.py tests/team/test_facility.py -k "time_limit or alarm"
try "a time limit in the first call of a process" tests/team/test_loading.py
try "same seed twice, other threads and hash seeds" tests/stages/test_chain_stages.py -k "threads"
try "a restored row replays"                  tests/sim/test_batch.py tests/failures/test_discovery.py -k "replay"
try "mistyped configurations"                 tests/stages/test_stage.py tests/test_schema.py -k "mistake or path or wrong"
try "comment-only edits"                      tests/test_closure.py tests/stages/test_foreign_world.py -k "digest or not_ours or edit"
[ ${#words[@]} -gt 0 ] || load # killed before it has begun, a load would take the log with it
try "8 first writers of a store, under load"  tests/tracking -k "together or making or waits"
[ ${#busy[@]} -eq 0 ] || kill "${busy[@]}" 2> /dev/null; busy=()
try "a failing job of a sweep, a stopped one"  tests/stages/test_stage.py -k "sweep"
try "empty inputs"                            tests/failures tests/team/test_files.py tests/sim/test_batch.py -k "empty or no_failure or no_rows or mistake"
try "half a table, picture, film or configuration" tests/test_manifest.py tests/evaluation/page/test_report.py -k "half or change or damaged"
try "another processor's last bits"           tests/test_archive.py tests/metareskill/test_playbook.py tests/team/test_study.py -k "kept or last_bits or ledger"
try "a tracking server that dies"             tests/tracking/test_outbox.py
try "an environment's process that dies, a row that was kept" tests/worlds/test_gymnasium.py -k "dies or goes_on or slots"
try "no GL, or one that is not there"         tests/test_gl.py
try "a full disk, a folder that is a file"    tests/test_artifacts.py -k "full_disk"
try "an install beside somebody else's folders" tests/test_install.py
[ $failed -eq 0 ] && echo "all pass" || { echo "$failed failed"; exit 1; }
