"""The runner: a child that misbehaves ends its own call and nothing else."""

from __future__ import annotations

import pickle
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import psutil
import pytest

from engine.errors import TopologyError
from service.domain import NotFound
from service.jobtypes import Event
from service.runner import ChildError, Limits, Outcome, Runner, RunnerError
from tests.service.core import ROOT, eventually, gone, kill

JOBS = "tests.service.fake_jobs:"
MIB = 1024**2


@pytest.fixture(scope="module")
def runner() -> Iterator[Runner]:
    made = Runner(("engine.pipeline", "tests.service.fake_jobs"))
    made.wait_until_ready()
    yield made
    made.close()


def call(runner: Runner, name: str, payload: object = None, seconds: float = 30.0) -> Outcome:
    return runner.call(JOBS + name, payload, Limits(seconds, 300 * MIB))


def test_a_call_returns_what_the_function_returns(runner: Runner) -> None:
    outcome = call(runner, "double", 21)
    assert (outcome.ending, outcome.value, outcome.error) == ("returned", 42, None)
    assert outcome.peak_bytes > 0


def test_large_payloads_and_answers_pass(runner: Runner) -> None:
    assert len(call(runner, "big_answer", 20 * MIB).value) == 20 * MIB
    assert call(runner, "double", "x" * 5 * MIB).value == "x" * 10 * MIB


def test_every_call_has_a_process_of_its_own(runner: Runner) -> None:
    with ThreadPoolExecutor(8) as pool:
        outcomes = list(pool.map(lambda _: call(runner, "own_pid"), range(24)))
    pids = [outcome.value for outcome in outcomes]
    assert len(set(pids)) == 24
    eventually(lambda: all(gone(pid) for pid in pids))


def test_a_start_takes_less_than_an_interpreter_of_its_own(runner: Runner) -> None:
    took = [call(runner, "double", 1).seconds for _ in range(15)]
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import engine.pipeline"], check=True)
    assert statistics.median(took) < (time.perf_counter() - began) / 4


def test_events_arrive_while_the_function_runs(runner: Runner) -> None:
    seen: list[tuple[float, Event]] = []

    def note(event: Event) -> None:
        seen.append((time.monotonic(), event))

    outcome = runner.call(JOBS + "report_and_sleep", 0.5, Limits(30, 300 * MIB), on_event=note)
    assert outcome.value == "slept"
    assert [event["progress"] for _, event in seen] == [0.0, 0.2, 0.4, 0.6, 0.8]
    assert seen[-1][0] - seen[0][0] > 0.3


def test_refusals_come_back_as_themselves_and_bugs_with_their_traceback(runner: Runner) -> None:
    refused = call(runner, "refuse").error
    assert isinstance(refused, TopologyError)
    assert (refused.code, refused.elements) == ("no_surface", {"faces": [1, 2]})
    assert isinstance(call(runner, "refuse_domain").error, NotFound)
    bug = call(runner, "bug")
    assert (bug.ending, type(bug.error)) == ("raised", ChildError)
    assert "KeyError" in bug.detail
    assert "fake_jobs.py" in bug.error.__notes__[0]
    assert "nothing" in call(runner, "nothing").detail
    pickle.loads(pickle.dumps(bug))


@pytest.mark.parametrize(
    ("name", "payload", "said"), [("segfault", None, "SIGSEGV"), ("exit_at_once", 3, "code 3")]
)
def test_a_crash_is_told_from_the_outside(
    runner: Runner, name: str, payload: object, said: str
) -> None:
    outcome = call(runner, name, payload)
    assert outcome.ending == "crashed"
    assert said in outcome.detail


@pytest.mark.parametrize("name", ["eat_memory", "eat_memory_at_once"])
def test_memory_has_a_limit(runner: Runner, name: str) -> None:
    outcome = call(runner, name)
    assert outcome.ending == "memory_limit"
    assert outcome.peak_bytes < 600 * MIB


def test_time_has_a_limit(runner: Runner) -> None:
    outcome = call(runner, "hang", seconds=0.3)
    assert outcome.ending == "time_limit"
    assert outcome.seconds < 1.5


def test_a_cancel_kills_within_a_second(runner: Runner) -> None:
    running = runner.start(JOBS + "hang", None, Limits(30, 300 * MIB))
    canceled: list[float] = []

    def cancel() -> None:
        canceled.append(time.monotonic())
        running.cancel()
        running.cancel()

    threading.Timer(0.2, cancel).start()
    assert running.result().ending == "canceled"
    assert time.monotonic() - canceled[0] < 1.0
    running.cancel()


def test_grandchildren_go_with_the_child(runner: Runner) -> None:
    left = call(runner, "leave_a_grandchild").value
    eventually(lambda: gone(left))


def test_a_failing_listener_kills_the_child(runner: Runner) -> None:
    def fail(event: Event) -> None:
        raise RuntimeError("no ear")

    before = set(psutil.Process().children(recursive=True))
    with pytest.raises(RuntimeError, match="no ear"):
        runner.call(JOBS + "hang", None, Limits(30, 300 * MIB), on_event=fail)
    eventually(lambda: set(psutil.Process().children(recursive=True)) <= before)


def test_a_killed_zygote_loses_its_children_and_is_replaced() -> None:
    before = set(psutil.Process().children())
    runner = Runner(("tests.service.fake_jobs",))
    runner.wait_until_ready()
    (zygote,) = set(psutil.Process().children()) - before
    running = runner.start(JOBS + "hang", None, Limits(30, 300 * MIB))
    eventually(lambda: bool(zygote.children()))
    (child,) = zygote.children()
    kill(zygote.pid)
    assert running.result().ending == "lost"
    eventually(lambda: gone(child.pid))
    assert call(runner, "double", 4).value == 8
    runner.close()
    with pytest.raises(RunnerError):
        call(runner, "double", 4)


def test_modules_that_cannot_be_imported_are_told_of(capfd: pytest.CaptureFixture[str]) -> None:
    runner = Runner(("no_such_module",))
    with pytest.raises(RunnerError, match="no_such_module"):
        runner.wait_until_ready()
    runner.close()
    assert "ModuleNotFoundError" in capfd.readouterr().err


OWNER = """
import sys, threading, time
from service.runner import Limits, Runner
runner = Runner(("tests.service.fake_jobs",))
call = runner.start("tests.service.fake_jobs:hang", None, Limits(60, 2**30))
print("started", flush=True)
call.result()
"""


def test_nothing_is_left_of_an_owner_that_is_killed() -> None:
    owner = subprocess.Popen([sys.executable, "-c", OWNER], cwd=ROOT, stdout=subprocess.PIPE)
    assert owner.stdout is not None
    assert owner.stdout.readline() == b"started\n"
    eventually(lambda: len(psutil.Process(owner.pid).children(recursive=True)) == 2)
    family = psutil.Process(owner.pid).children(recursive=True)
    owner.kill()
    owner.wait()
    owner.stdout.close()
    eventually(lambda: all(gone(one.pid) for one in family))
