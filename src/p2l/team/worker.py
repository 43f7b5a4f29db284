"""Planning in a process of its own, which can be stopped.

HiGHS looks at its clock between the steps of its search, and some take far longer than a time limit (15 s of 3 at 200
tasks of the max form). Nothing inside the process can end such a step.
"""

from __future__ import annotations

import io
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from p2l.errors import P2LError, SolverError
from p2l.team.contract import PlannerResult, StoppingRule
from p2l.team.problem import Certificate, Order, Problem
from p2l.team.programs import PROGRAMS

_PARTS = ("c_rob", "c_hum", "c_fail", "c_demo", "pretrained", "transfer")
_HANDING_OVER_BYTES_PER_S = 2e8
_RETURNING_S = 0.1  # before the deadline a result must be on its way


def plan_apart(problem: Problem, planner: str, deadline: float, gap: float) -> PlannerResult | None:
    """What a planner of `PROGRAMS` comes back with; None if it does not by the `deadline` of `time.perf_counter`.

    Raises:
        SolverError: the planner cannot treat this instance.
    """
    if time.perf_counter() + problem.transfer.nbytes / _HANDING_OVER_BYTES_PER_S >= deadline:
        return None
    with TemporaryDirectory(prefix="p2l-plan-") as folder:
        file = Path(folder) / "problem.npz"
        np.savez(file, order=np.array(problem.order), **{name: getattr(problem, name) for name in _PARTS})
        latest_s = time.time() + deadline - time.perf_counter()  # the one clock that both processes have
        command = [sys.executable, "-m", "p2l.team.worker", str(file), planner, repr(latest_s), repr(gap)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            try:
                answer, message = process.communicate(timeout=max(0.0, deadline - time.perf_counter()))
            except subprocess.TimeoutExpired:
                process.kill()
                return None
            finally:
                process.kill()
    if process.returncode:
        raise SolverError(message.decode(errors="replace").strip() or f"planner '{planner}': its process died")
    with np.load(io.BytesIO(answer), allow_pickle=False) as arrays:
        certificate = Certificate.of(arrays["multipliers"]) if "multipliers" in arrays else None
        return PlannerResult(arrays["decision"], bool(arrays["complete"]), certificate)


def main(file: str, planner: str, latest_s: str, gap: str) -> int:
    """Read a problem, plan, and write the result to standard output."""
    with np.load(file, allow_pickle=False) as arrays:
        parts = {name: arrays[name] for name in _PARTS}
        order: Order = "any" if str(arrays["order"]) == "any" else "fixed"
        problem = Problem(tuple(map(str, range(len(parts["c_rob"])))), **parts, order=order)
    deadline = time.perf_counter() + float(latest_s) - time.time() - _RETURNING_S
    try:
        result = PROGRAMS[planner](problem, StoppingRule(deadline, float(gap)))
    except P2LError as error:
        sys.stderr.write(str(error))
        return P2LError.exit_code
    proof = {} if result.certificate is None else {"multipliers": result.certificate.multipliers[0]}
    answer = io.BytesIO()
    np.savez(answer, decision=result.decision, complete=np.array(result.complete), **proof)
    sys.stdout.buffer.write(answer.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
