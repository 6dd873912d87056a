"""The two errors that a user of refsim meets; each carries the exit code of the command line."""


class RefsimError(Exception):
    """Base of the errors that end a command with one clear sentence instead of a traceback."""

    exit_code = 1


class InputError(RefsimError):
    """Bad input (exit code 2). The message is one sentence: what is wrong, where, and what to do about it."""

    exit_code = 2


class RunStopped(RefsimError):
    """The run cannot go on as it is (exit code 3).

    `reason` is a short fixed name for programs ("disk_full", "non_finite", ...), the message a sentence for
    people.
    """

    exit_code = 3

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(reason, message)  # both, so that the error survives pickling between processes
        self.reason = reason

    def __str__(self) -> str:
        return self.args[1]
