"""The check of drivers on the bench of SCPI instruments: it passes all that applies to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from imotor_ros.campaign.conformance.requirements import Result, Verdict


def test_scpi_bench_passes(check_driver: Callable[..., dict[str, Result]], laboratory: Any) -> None:
    """With 12 bits, and a record that is interpolated to the program's rate where it has to be."""
    patient = {"trigger_timeout": 15.0, "reply_timeout": 15.0}  # a busy host is no defect
    results = check_driver("scpi_bench", **{**laboratory.settings(), **patient})
    evidence = {
        verdict: {name: one.evidence for name, one in results.items() if one.verdict is verdict}
        for verdict in Verdict
    }
    assert evidence[Verdict.FAIL] == {}
    assert evidence[Verdict.NOT_APPLICABLE] == {
        "L4": "the driver was to be started once only",
        "S1": "the driver collects the whole program before it plays it",
        "S2": "the driver plays from a memory of its own: see S3",
    }
