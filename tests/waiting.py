"""Run a command for as long as it gets on, however slowly: other work on the machine must not fail a test."""

import subprocess
import threading
import time

import psutil

IDLE_S = 240.0  # without a tenth of a second of computing, of the process or of any below it


def _worked_s(process):
    """Seconds that a process and those below it have computed."""
    try:
        family = [process, *process.children(recursive=True)]
    except psutil.NoSuchProcess:
        return 0.0
    total = 0.0
    for one in family:
        try:
            times = one.cpu_times()
            total += times.user + times.system + times.children_user + times.children_system
        except psutil.NoSuchProcess:
            continue
    return total


def _watch(process, ended):
    worked_s, since = 0.0, time.monotonic()
    while not ended.wait(1.0):
        now_s = _worked_s(process)
        if now_s > worked_s + 0.1:
            worked_s, since = now_s, time.monotonic()
        elif time.monotonic() - since > IDLE_S:
            for one in [*process.children(recursive=True), process]:
                one.kill()
            return


def run(command, *, check=False, **keywords):
    """Like `subprocess.run` with captured text, but a hanging command is killed, and a slow one is not."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **keywords) as process:
        ended = threading.Event()
        watch = threading.Thread(target=_watch, args=(psutil.Process(process.pid), ended), daemon=True)
        watch.start()
        try:
            out, err = process.communicate()
        finally:
            ended.set()
    done = subprocess.CompletedProcess(command, process.returncode, out, err)
    assert not check or done.returncode == 0, f"{command}\n{out[-4000:]}\n{err[-4000:]}"
    return done


def until(condition):
    """Return once `condition()` holds; what never comes is an error in the end."""
    start = time.monotonic()
    while not condition():
        assert time.monotonic() - start < IDLE_S, "it never came"
        time.sleep(0.02)
