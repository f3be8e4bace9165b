"""Work of a process of its own, beside the command.

What is slow because it is Python gains nothing from a thread: JAX traces in Python too.
"""

import os
import pickle
import subprocess
import sys
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from importlib import import_module
from queue import SimpleQueue
from threading import Thread
from typing import Any, BinaryIO, NamedTuple, Self, TypeVar

SIZE = 8  # bytes before a task that say how many it has
Result = TypeVar("Result")


class _Answer(NamedTuple):
    """Result of a process, and what it would have warned of."""

    result: Any
    warned: list[str]


class Beside:
    """A process that does one thing after another while the block runs, on the CPU.

    It knows no Ctrl-C of its own: it is stopped with the block, and ends at once where the program
    is killed, also in the middle of a task. Where it fails, or where a task cannot be handed over,
    the task is done here when its result is asked for, and what is wrong is raised here.

    Args:
        modules: that it loads while it waits for its first task.
    """

    def __init__(self, *modules: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__, *modules],  # -P: nothing of the folder it is in
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            env=os.environ | {"JAX_PLATFORMS": "cpu"},
        )
        self._exchange = ThreadPoolExecutor(1)  # a pipe holds less than what is sent

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._exchange.shutdown()
        self._process.communicate()

    def submit(self, function: Callable[..., Result], *arguments: Any) -> Callable[[], Result]:
        """Add a task; what is returned waits for its result."""
        try:
            task = pickle.dumps((function, arguments))
        except (pickle.PicklingError, AttributeError, TypeError):  # as a class made in a function
            return lambda: function(*arguments)
        answer = self._exchange.submit(self._answer, task)

        def result() -> Result:
            outcome = answer.result()
            if outcome is None:
                return function(*arguments)
            for message in outcome.warned:
                warnings.warn(message, stacklevel=2)
            return outcome.result

        return result

    def _answer(self, task: bytes) -> _Answer | None:
        """The process's answer; None where it has ended."""
        sent, answers = self._process.stdin, self._process.stdout
        assert sent is not None and answers is not None
        try:
            sent.write(len(task).to_bytes(SIZE) + task)
            sent.flush()
            return _Answer(*pickle.load(answers))
        except (OSError, ValueError, EOFError, pickle.UnpicklingError):
            return None


def _read(tasks: BinaryIO, waiting: SimpleQueue[bytes]) -> None:
    """Read tasks, and end the process where their pipe ends: whoever asks is gone."""
    while size := tasks.read(SIZE):
        waiting.put(tasks.read(int.from_bytes(size)))
    os._exit(0)


if __name__ == "__main__":
    answers, waiting = sys.stdout.buffer, SimpleQueue[bytes]()
    with redirect_stdout(sys.stderr):  # what a task prints is no answer
        Thread(target=_read, args=(sys.stdin.buffer, waiting), daemon=True).start()
        for module in sys.argv[1:]:
            import_module(module)
        while True:
            function, arguments = pickle.loads(waiting.get())
            with warnings.catch_warnings(record=True) as warned:
                result = function(*arguments)
            messages = [str(one.message) for one in warned if one.category is UserWarning]
            answers.write(pickle.dumps((result, messages)))
            answers.flush()
