"""What hangs is killed, what is slow is not."""

import sys

from tests import waiting


def test_a_hanging_command_is_killed_and_a_busy_one_is_waited_for(monkeypatch):
    monkeypatch.setattr(waiting, "IDLE_S", 3.0)
    hanging = waiting.run([sys.executable, "-c", "import time; time.sleep(1e6)"])
    assert hanging.returncode == -9
    busy = "import time\nend = time.process_time() + 6\nwhile time.process_time() < end: pass\nprint('done')"
    assert waiting.run([sys.executable, "-c", busy]).stdout == "done\n"
