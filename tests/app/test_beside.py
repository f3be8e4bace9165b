"""Work of another process: what it finds, warns of and fails at, and that it ends."""

import math
import os
import signal
import subprocess
import sys
import time
import warnings

import pytest

from jcontour.app.beside import Beside


def ended(pid: int) -> bool:
    for _ in range(100):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False


def test_tasks_are_done_by_one_other_process_in_their_order():
    with Beside("fractions") as process:
        results = [process.submit(os.getpid), process.submit(math.hypot, 3.0, 4.0)]
        results += [process.submit(os.getpid)]
        first, length, last = (result() for result in results)
    assert first == last != os.getpid()
    assert length == 5.0


def test_more_is_sent_than_a_pipe_holds():
    with Beside() as process:
        assert process.submit(len, bytes(10**7))() == 10**7
        assert process.submit(bytes, 10**7)() == bytes(10**7)


def test_what_is_wrong_is_raised_here_and_what_follows_is_done_here():
    with Beside() as process:
        wrong, right = process.submit(math.sqrt, -1.0), process.submit(os.getpid)
        with pytest.raises(ValueError, match="math domain error|nonnegative"):
            wrong()
        assert right() == os.getpid()


def test_what_cannot_be_handed_over_is_done_here():
    with Beside() as process:
        assert process.submit(lambda: os.getpid())() == os.getpid()


def test_tasks_are_done_here_where_no_process_can(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with Beside() as process:
        assert process.submit(os.getpid)() == os.getpid()


def test_warnings_are_told_here_and_prints_are_no_answer():
    with Beside() as process, warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        assert process.submit(warnings.warn, "little is known")() is None
        assert process.submit(print, "a word")() is None
    assert [str(one.message) for one in told] == ["little is known"]


def test_the_process_ends_with_an_interrupted_block():
    with pytest.raises(KeyboardInterrupt), Beside() as process:
        pid = process.submit(os.getpid)()
        process.submit(time.sleep, 60)
        raise KeyboardInterrupt
    assert ended(pid)


def test_the_process_ends_where_the_program_is_killed():
    program = (
        "import os, time\n"
        "from jcontour.app.beside import Beside\n"
        "with Beside() as process:\n"
        "    print(process.submit(os.getpid)(), flush=True)\n"
        "    process.submit(time.sleep, 60)\n"
        "    time.sleep(60)\n"
    )
    killed = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert killed.stdout is not None
    pid = int(killed.stdout.readline())
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    assert ended(pid)
