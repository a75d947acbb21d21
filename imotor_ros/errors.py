"""
Errors of the test stand.

::

    ImotorError
    ├── BadInputError (ValueError)       a value from outside that cannot be used
    │   ├── DriveLimitError              a drive beyond the limits: what is needed and allowed
    │   ├── UnknownKeyError              a key that no parameter has
    │   └── UnreadableFileError          a file that is missing, is no bag, or does not parse
    ├── RunError (RuntimeError)          a run that started did not reach its end
    │   ├── NodeDiedError                a node ended although the run had not
    │   ├── DeadlineError (TimeoutError) something waited for did not come in time
    │   ├── SamplesLostError             samples of a stream are missing
    │   ├── DriveFaultError              the plant or driver reported a fault
    │   ├── StoppedError                 an operator stopped the drive: no other run may start it
    │   ├── InstrumentError              an instrument of a bench does not do what it is told
    │   ├── ExcitationError              no voltage was found that moves the rod as wanted
    │   └── RecordingError (OSError)     a bag, results or a picture cannot be written
    └── SolverError (ArithmeticError)    a solver cannot go on

`BadInputError` ends a command with exit code 2, every other `ImotorError` with exit code 1.
"""

from __future__ import annotations


class ImotorError(Exception):
    """Base of all errors raised on purpose by this package."""


class BadInputError(ImotorError, ValueError):
    """
    A value given from outside cannot be used.

    Parameters
    ----------
    what : str
        What is wrong with it, e.g. "is out of bounds".
    where : str
        Where it stands: a key, an option or a file, e.g. "slider.mass".
    value : object, optional
        The value found.
    bound : str, optional
        What would have been accepted, with its unit.

    """

    def __init__(self, what: str, *, where: str, value: object = None, bound: str = "") -> None:
        self.what = what
        self.where = where
        self.value = value
        self.bound = bound
        text = f"{where}: {what}"
        if value is not None:
            text += f", got {value!r}"
        if bound:
            text += f", expected {bound}"
        super().__init__(text)


class DriveLimitError(BadInputError):
    """
    A drive needs more than motor or amplifier allow.

    Parameters
    ----------
    where : str
        What needs it, e.g. "hold".
    quantity : str
        What it needs too much of, e.g. "voltage".
    needed, allowed : float
        How much, and the bound that is passed (unit).
    unit : str
        SI unit.

    """

    def __init__(self, where: str, quantity: str, needed: float, allowed: float, unit: str) -> None:
        self.quantity = quantity
        self.needed = needed
        self.allowed = allowed
        self.unit = unit
        side = "at most" if needed > allowed else "at least"
        super().__init__(
            f"needs a {quantity} of {needed:.4g} {unit}",
            where=where,
            bound=f"{side} {allowed:.4g} {unit}",
        )


class UnknownKeyError(BadInputError):
    """A key that no parameter has."""


class UnreadableFileError(BadInputError):
    """A file that is missing, is not what it should be, or does not parse."""


class RunError(ImotorError, RuntimeError):
    """A run that had started did not reach its end."""


class NodeDiedError(RunError):
    """
    A node ended although the run had not.

    Parameters
    ----------
    node : str
        Name of the node.
    status : str
        How it ended, e.g. "exit code 1" or "signal SIGKILL".
    last_lines : sequence of str
        The last lines that it wrote to its log.

    """

    def __init__(self, node: str, status: str, last_lines: tuple[str, ...] = ()) -> None:
        self.node = node
        self.status = status
        self.last_lines = tuple(last_lines)
        text = f"node {node} ended during the run ({status})"
        if self.last_lines:
            text += "; its last lines:\n" + "\n".join(f"    {line}" for line in self.last_lines)
        super().__init__(text)


class DeadlineError(RunError, TimeoutError):
    """
    Something waited for did not come in time.

    Parameters
    ----------
    awaited : str
        What was waited for.
    seconds : float
        How long (s).

    """

    def __init__(self, awaited: str, seconds: float) -> None:
        self.awaited = awaited
        self.seconds = seconds
        super().__init__(f"waited {seconds:g} s for {awaited}, in vain")


class SamplesLostError(RunError):
    """
    Samples of a stream are missing.

    Parameters
    ----------
    stream : str
        Name of the stream.
    expected, found : int
        Index of the sample that should have come next, and of the one that came.

    """

    def __init__(self, stream: str, expected: int, found: int) -> None:
        self.stream = stream
        self.expected = expected
        self.found = found
        super().__init__(f"{stream}: expected sample {expected}, got sample {found}")


class DriveFaultError(RunError):
    """The plant or the driver reported a fault and stopped."""


class InstrumentError(RunError):
    """
    An instrument of a bench does not do what it is told.

    Parameters
    ----------
    instrument : str
        Which one, e.g. "generator".
    command : str
        What it was told or asked; empty where it is about no single command.
    what : str
        What came of it.

    """

    def __init__(self, instrument: str, command: str, what: str) -> None:
        self.instrument = instrument
        self.command = command
        self.what = what
        super().__init__(": ".join(part for part in (instrument, command, what) if part))


class StoppedError(RunError):
    """
    An operator stopped the drive, e.g. by the service ``drive/stop``.

    It concerns all runs that would come after: the voltage stays at zero until somebody starts
    anew.
    """

    def __init__(self, what: str) -> None:
        super().__init__(f"{what} was stopped by an operator; the voltage is at zero")


class ExcitationError(RunError):
    """No voltage was found that moves the rod as wanted; the text says why."""


class RecordingError(RunError, OSError):
    """The bag of a run, or what else is kept of it, cannot be written."""


class SolverError(ImotorError, ArithmeticError):
    """A solver cannot go on, or did not reach the accuracy asked for."""
