"""The requirements on a driver, by the ids that docs/driver_specification.md explains."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum


class Verdict(Enum):
    """What a check says of a requirement."""

    PASS = "pass"
    FAIL = "fail"
    NOT_APPLICABLE = "not applicable"


@dataclass(frozen=True)
class Requirement:
    """
    One requirement.

    Attributes
    ----------
    id : str
        A letter for its section and a number, e.g. "S2".
    title : str
        What has to hold, in a line.

    """

    id: str
    title: str


REQUIREMENTS = (
    Requirement("I1", "message types and directions of all topics"),
    Requirement("I2", "quality of service: streams reliable, facts latched"),
    Requirement("I3", "one writer per stream, and none where others write"),
    Requirement("I4", "faults stand in /diagnostics as errors until they are cleared"),
    Requirement("L1", "every node has a lifecycle and starts unconfigured"),
    Requirement("L2", "configure, activate, deactivate, clean up, and again"),
    Requirement("L3", "transitions that a state does not have are refused"),
    Requirement("L4", "shutdown ends the process with exit code 0"),
    Requirement("L5", "another run in the same activation starts anew"),
    Requirement("L6", "another run after deactivation starts anew"),
    Requirement("C1", "every channel is described, for the run, to late comers too"),
    Requirement("C2", "quantities and units are those of the stand"),
    Requirement("C3", "the numbers of every description are possible"),
    Requirement("D1", "no sample is missing, and all streams reach the program's end"),
    Requirement("D2", "stamps are epoch + index / rate, in integers"),
    Requirement("D3", "sample rate is that of the program"),
    Requirement("D4", "run, unit and channel stand in every block"),
    Requirement("D5", "every sample is a finite number within the channel's range"),
    Requirement("F1", "all that is sent is acknowledged, in time"),
    Requirement("F2", "acknowledgements never go back nor beyond what was sent"),
    Requirement("F3", "a slow reader loses nothing"),
    Requirement("F4", "blocks of any length, in bursts or late"),
    Requirement("F5", "a reader that is missing neither hangs nor ends the driver"),
    Requirement("V1", "the monitor shows the voltage asked for"),
    Requirement("V2", "voltage out of range is refused or limited, and told"),
    Requirement("V3", "voltage that is no number is refused"),
    Requirement("A1", "rod and slider are what they say, and point forward"),
    Requirement("A2", "channels lag the voltage by the delays declared"),
    Requirement("A3", "all channels keep one clock through the run"),
    Requirement("S1", "a sample is acknowledged when it is put out, not before"),
    Requirement("S2", "a program that is stopped is followed to zero, at its new length"),
    Requirement("S3", "a stop ends what is played from a memory of the driver's own"),
    Requirement("S4", "a program that is abandoned leaves no voltage on"),
    Requirement("S5", "a generator that falls silent leaves no voltage on"),
    Requirement("S6", "a fault of the driver's own leaves no voltage on, and is told"),
    Requirement("S7", "deactivated or told to end, the driver takes the voltage off first"),
    Requirement("S8", "another run begins at rest, whatever the last one left"),
    Requirement("S9", "after a fault nothing is taken before a new activation"),
)
"""All requirements, in the order of the report."""


@dataclass(frozen=True)
class Finding:
    """
    What one check found.

    Attributes
    ----------
    requirement : str
        Id of the requirement.
    verdict : Verdict
        What it says.
    evidence : str
        What was measured, or why it does not apply.

    """

    requirement: str
    verdict: Verdict
    evidence: str


class Findings(list[Finding]):
    """What the checks found so far."""

    def passes(self, requirement: str, evidence: str) -> None:
        """Note that a requirement is met."""
        self.append(Finding(requirement, Verdict.PASS, evidence))

    def fails(self, requirement: str, evidence: str) -> None:
        """Note that a requirement is not met."""
        self.append(Finding(requirement, Verdict.FAIL, evidence))

    def skips(self, requirements: str, reason: str) -> None:
        """Note that requirements, ids with blanks between, do not apply."""
        for one in requirements.split():
            self.append(Finding(one, Verdict.NOT_APPLICABLE, reason))

    def judge(self, requirement: str, defects: Iterable[str], evidence: str) -> None:
        """Note every defect as a failure; without one, that the requirement is met."""
        found = list(defects)
        for defect in found:
            self.fails(requirement, defect)
        if not found:
            self.passes(requirement, evidence)


_MOST_TEXTS = 4
"""Pieces of evidence shown for one requirement."""


@dataclass(frozen=True)
class Result:
    """What all checks together say of one requirement."""

    requirement: Requirement
    verdict: Verdict
    evidence: str


def conclude(findings: Iterable[Finding], unreached: str = "") -> tuple[Result, ...]:
    """
    Return one result for each requirement: a failure outweighs a pass, a pass what is left out.

    Parameters
    ----------
    findings : iterable of Finding
        What the checks found.
    unreached : str
        Why requirements without a finding have none.

    """
    found = list(findings)
    return tuple(_conclude(one, found, unreached) for one in REQUIREMENTS)


def _conclude(requirement: Requirement, findings: list[Finding], unreached: str) -> Result:
    own = [one for one in findings if one.requirement == requirement.id]
    for verdict in (Verdict.FAIL, Verdict.PASS, Verdict.NOT_APPLICABLE):
        texts = list(dict.fromkeys(one.evidence for one in own if one.verdict is verdict))
        if texts:
            more = f"; and {len(texts) - _MOST_TEXTS} more" if len(texts) > _MOST_TEXTS else ""
            return Result(requirement, verdict, "; ".join(texts[:_MOST_TEXTS]) + more)
    return Result(requirement, Verdict.NOT_APPLICABLE, f"not reached: {unreached or 'no check'}")
