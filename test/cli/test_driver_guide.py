"""The guide to a driver: its code is the template's, its commands and links lead somewhere."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GUIDE = (ROOT / "docs" / "write_a_driver.md").read_text(encoding="utf-8")
TEMPLATE = (ROOT / "imotor_ros" / "nodes" / "template_driver.py").read_text(encoding="utf-8")


def test_code_in_the_guide_is_that_of_the_template() -> None:
    fragments = re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL)
    assert len(fragments) >= 5
    for fragment in fragments:
        assert textwrap.indent(fragment, "    ") in TEMPLATE, fragment


def test_files_and_names_in_the_guide_exist() -> None:
    for path in re.findall(r"\b(?:imotor_ros|docs|bench|params)/[\w./]+\.\w+", GUIDE):
        assert (ROOT / path).exists(), path
    for link in re.findall(r"\]\(([\w.]+)\)", GUIDE):
        assert (ROOT / "docs" / link).exists(), link


def test_what_the_guide_names_is_there() -> None:
    pytest.importorskip("rclpy", reason="needs ROS 2")
    from imotor_ros import errors
    from imotor_ros.core.channel import ChannelDescription
    from imotor_ros.core.evaluator_parameters import EvaluatorParameters
    from imotor_ros.nodes import card_driver, guarded_driver
    from imotor_ros.nodes.template_driver import TemplateDriverNode, TemplateParameters

    for name in ("InstrumentError", "BadInputError"):
        assert name in GUIDE
        assert hasattr(errors, name)
    for name in ("connect", "disconnect", "arm", "write", "read", "switch_off"):
        assert name in GUIDE
        assert callable(getattr(TemplateDriverNode, name))
    for name in ("pace", "seed", "stand", "lowest_voltage", "highest_voltage"):
        assert f"`{name}`" in GUIDE
        assert hasattr(TemplateParameters(), name)
    for name in ("delay", "gain_uncertainty", "range", "resolution", "bandwidth", "low_pass"):
        assert f"`{name}`" in GUIDE
        assert name in ChannelDescription.__dataclass_fields__
    assert hasattr(EvaluatorParameters(), "plausibility")
    assert pytest.approx(15e-3) == card_driver.RAMP_TIME
    assert guarded_driver.GuardedDriverNode.__name__ in GUIDE
