"""One set-up at a time, and programs that leave nothing behind."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from bootstrap import installation, processes
from bootstrap.errors import SetupError
from bootstrap.lockfile import SetupLock

ROOT = Path(__file__).resolve().parents[2]
DEADLINE = 20.0


def wait_until(condition, what):
    end = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < end, f"waited {DEADLINE} s for {what}"
        threading.Event().wait(0.01)


HOLDER = """
import sys
sys.path.insert(0, sys.argv[1])
from bootstrap.lockfile import SetupLock
with SetupLock(sys.argv[2], lambda: None):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def holder(tmp_path):
    """Another process that holds the lock until its input is closed."""
    path = tmp_path / "home" / "lock"
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, ROOT, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout.readline() == b"held\n"
        yield path, process
        process.kill()


def test_lock_waits_and_says_so_once(holder):
    path, process = holder
    waits = []
    with SetupLock(str(path), lambda: (waits.append(1), process.stdin.close())):
        assert process.wait(DEADLINE) == 0
    assert waits == [1]


def test_lock_of_a_killed_set_up_is_free(holder):
    path, process = holder
    process.kill()
    process.wait(DEADLINE)
    with SetupLock(str(path), lambda: None):
        pass


def test_lock_file_removed_while_waiting_is_made_anew(holder):
    path, process = holder

    def remove_then_release():
        path.unlink()
        process.stdin.close()

    with SetupLock(str(path), remove_then_release) as lock:
        assert os.path.samestat(os.fstat(lock.fileno()), path.stat())


@pytest.fixture
def lock(tmp_path):
    with SetupLock(str(tmp_path / "lock"), lambda: None) as lock:
        yield lock


def test_program_writes_output_to_the_log(tmp_path, lock):
    log = tmp_path / "setup.log"
    shown = []
    programs = processes.Programs(str(log), lock, shown.append)
    assert programs.run(["sh", "-c", "echo one; echo two >&2"], os.environ, "/") == "one\ntwo\n"
    assert log.read_text() == "\n$ sh -c echo one; echo two >&2\none\ntwo\n"
    assert shown[-1] == "two"


def test_missing_program_is_named(tmp_path, lock):
    programs = processes.Programs(str(tmp_path / "setup.log"), lock, lambda _: None)
    with pytest.raises(SetupError, match="cannot start /nowhere/cmake: No such file"):
        programs.run(["/nowhere/cmake"], os.environ, "/")


def test_interrupt_stops_the_program_and_its_children(tmp_path, lock):
    def interrupt(line):
        if line:
            raise installation.Interrupted(signal.SIGTERM)

    programs = processes.Programs(str(tmp_path / "setup.log"), lock, interrupt)
    with pytest.raises(installation.Interrupted):
        programs.run(["sh", "-c", "sleep 600 & echo $!; wait"], os.environ, "/")
    child = int((tmp_path / "setup.log").read_text().split()[-1])
    wait_until(lambda: not is_running(child), "the child to end")


def is_running(process_id):
    try:
        status = Path(f"/proc/{process_id}/stat").read_text()
    except FileNotFoundError:
        return False
    return status.split(") ")[1][0] != "Z"


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("OSError: [Errno 28] No space left on device", "the disk is full"),
        ("Retrying ... Temporary failure in name resolution", "no network"),
        ("ERROR: No matching distribution found for numpy==9 (x)", "or lacks numpy==9"),
        ("CMake Error: cannot find x\nmore", "cmake failed with exit code 2: CMake Error"),
        ("", "cmake failed with exit code 2"),
    ],
)
def test_failure_is_explained_in_one_line(output, message):
    explained = processes.explain(output, "cmake", 2)
    assert message in explained
    assert "\n" not in explained
