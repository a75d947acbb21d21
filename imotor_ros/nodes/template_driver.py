"""
A driver to copy: one streaming card, five channels, all on one clock.

As it stands it drives a simulated card. For your rig, copy this file, put your card in the place of
`SimulatedCard`, and write down what is wired to it: docs/write_a_driver.md goes through it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from rclpy.context import Context

from imotor_ros.core.channel import (
    CURRENT,
    LOAD_FORCE,
    ROD_VELOCITY,
    SLIDER_VELOCITY,
    VOLTAGE,
    ChannelDescription,
)
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.parameters import group, parameter
from imotor_ros.core.samples import Samples
from imotor_ros.core.stand import StandParameters
from imotor_ros.nodes.card_driver import CardDriverNode, CardDriverParameters, Measured
from imotor_ros.nodes.simulated_card import SimulatedCard, drive_flags
from imotor_ros.nodes.stand_node import run_node


# [parameters]
@dataclass(frozen=True)
class TemplateParameters(CardDriverParameters):
    """Parameters of the driver: how the card is wired, and how fast it runs."""

    amplifier_gain: float = parameter(
        20.0, "stator voltage per volt of the card's output", unit="V/V", low=0.1, high=1e3
    )
    voltage_sensitivity: float = parameter(
        20.0, "voltage per volt of the voltage monitor", unit="V/V", low=0.1, high=1e3
    )
    current_sensitivity: float = parameter(
        1.0, "current per volt of the current monitor", unit="A/V", low=1e-3, high=1e3
    )
    rod_sensitivity: float = parameter(
        0.125, "velocity per volt of the rod's vibrometer", unit="m/s/V", low=1e-3, high=10.0
    )
    slider_sensitivity: float = parameter(
        0.125, "velocity per volt of the slider's vibrometer", unit="m/s/V", low=1e-3, high=10.0
    )
    force_sensitivity: float = parameter(
        0.5, "force per volt of the charge amplifier", unit="N/V", low=1e-3, high=1e3
    )
    pace: float = parameter(
        0.0, "speed of the simulated card over real time; 0 for as fast as it computes", low=0.0,
        high=100.0,
    )  # fmt: skip
    seed: int = parameter(1, "seed of all that is random in the simulated rig", low=0)
    stand: StandParameters = group(StandParameters)  # of the simulated rig; a real one has none

    @property
    def sensitivities(self) -> dict[str, float]:
        """What a volt at each input means (SI unit per V)."""
        return {
            VOLTAGE: self.voltage_sensitivity,
            CURRENT: self.current_sensitivity,
            ROD_VELOCITY: self.rod_sensitivity,
            SLIDER_VELOCITY: self.slider_sensitivity,
            LOAD_FORCE: self.force_sensitivity,
        }


# [end]


class TemplateDriverNode(CardDriverNode[TemplateParameters]):
    """Plays the voltage on the card, and publishes what its inputs show."""

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        super().__init__("template_driver", TemplateParameters, context=context, **options)
        self._card: SimulatedCard | None = None

    @property
    def card(self) -> SimulatedCard:
        """The card; there is one from `connect` to `disconnect`."""
        assert self._card is not None
        return self._card

    # [connect]
    def connect(self) -> None:
        """Find the card and claim it; raise InstrumentError if it is not there."""
        settings = self.parameters
        self._card = SimulatedCard(
            settings.stand,
            amplifier_gain=settings.amplifier_gain,
            sensitivities=settings.sensitivities,
            pace=settings.pace,
        )

    def disconnect(self) -> None:
        """Let go of the card."""
        self._card = None

    # [end]

    # [arm]
    def arm(self, program: DriveProgram) -> Sequence[ChannelDescription]:
        """Set the card's clock, start it at 0 V, and say what is wired to it."""
        self.connect()  # the parameters may have changed since
        self.card.start(program.sample_rate, self.parameters.seed)
        return [self.describe(name, sheet) for name, sheet in self.card.data_sheets().items()]

    def describe(self, name: str, sheet: ChannelDescription) -> ChannelDescription:
        """Return the description of a channel; on a rig, written down from its data sheet."""
        return replace(sheet, serial=f"simulated input of {name}")

    # [end]

    # [stream]
    def write(self, voltage: Samples) -> None:
        """Hand over the next samples (V at the stator) to the card's output memory."""
        self.card.write(voltage / self.parameters.amplifier_gain)

    def read(self) -> Measured:
        """Return what the card has put out and measured since the last call."""
        volts, flags = self.card.read()
        sensitivities = self.parameters.sensitivities
        samples = {name: sensitivities[name] * values for name, values in volts.items()}
        return Measured(samples, flags, drive_flags(flags))

    def status_values(self) -> dict[str, object]:
        """Return what the diagnostics show: also how often the card had nothing to put out."""
        underruns = self._card.underruns if self._card else 0
        return {**super().status_values(), "underruns": underruns}

    def switch_off(self) -> None:
        """Put out 0 V at once."""
        self.card.reset()

    # [end]


def main() -> int:
    """Run the node."""
    return run_node(TemplateDriverNode)
