"""The report of a check: JSON for programs, JUnit for continuous integration."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

from imotor_ros.campaign.conformance.requirements import Result, Verdict

SUITE = "check-driver"


def to_mapping(driver: str, results: Sequence[Result], duration: float) -> dict[str, Any]:
    """Return the JSON object of a check that took a time (s)."""
    counts = Counter(one.verdict.value for one in results)
    return {
        "driver": driver,
        "passed": has_passed(results),
        "counts": {verdict.value: counts[verdict.value] for verdict in Verdict},
        "duration": duration,
        "requirements": [
            {
                "id": one.requirement.id,
                "title": one.requirement.title,
                "verdict": one.verdict.value,
                "evidence": one.evidence,
            }
            for one in results
        ],
    }


def has_passed(results: Sequence[Result]) -> bool:
    """Whether no requirement failed."""
    return all(one.verdict is not Verdict.FAIL for one in results)


def to_junit(driver: str, results: Sequence[Result], duration: float) -> str:
    """Return the check as a JUnit file: one case for each requirement."""
    counts = Counter(one.verdict for one in results)
    suite = ElementTree.Element(
        "testsuite",
        name=f"{SUITE} {driver}",
        tests=str(len(results)),
        failures=str(counts[Verdict.FAIL]),
        errors="0",
        skipped=str(counts[Verdict.NOT_APPLICABLE]),
        time=f"{duration:.3f}",
    )
    for one in results:
        name = f"{one.requirement.id} {one.requirement.title}"
        case = ElementTree.SubElement(suite, "testcase", classname=SUITE, name=_plain(name))
        evidence = _plain(one.evidence)
        if one.verdict is Verdict.FAIL:
            failure = ElementTree.SubElement(case, "failure", message=evidence.splitlines()[0])
            failure.text = evidence
        elif one.verdict is Verdict.NOT_APPLICABLE:
            ElementTree.SubElement(case, "skipped", message=evidence)
        else:
            ElementTree.SubElement(case, "system-out").text = evidence
    root = ElementTree.Element("testsuites")
    root.append(suite)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _plain(text: str) -> str:
    """Return a text without the characters that XML cannot hold."""
    return re.sub(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd]", "?", text)
