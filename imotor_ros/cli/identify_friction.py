"""
Identify the friction between rod and slider by a sine of stepped amplitude.

From the bag of such a run, or from a run that is carried out for it, on the motor in a YAML file or
the paper's. Leaves the law as friction.yaml, which motor files and `imotor simulate` take as it is,
all numbers as identification.json, and pictures like figures 7, 8 and 9 of the paper.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from imotor_ros.bag.identify import identify_bag
from imotor_ros.campaign.campaign import Campaign, load_campaign, read_yaml
from imotor_ros.campaign.friction import check_friction_campaign
from imotor_ros.campaign.runner import DONE
from imotor_ros.cli.friction_pictures import draw_figures
from imotor_ros.cli.output import format_interval, print_json, table
from imotor_ros.cli.resources import find_params
from imotor_ros.cli.run import add_run_arguments, carry_out, output_folder
from imotor_ros.core.identification.records import IdentificationParameters
from imotor_ros.core.identification.results import Identification
from imotor_ros.core.motor import MotorParameters
from imotor_ros.errors import BadInputError, RunError

LAW_NAME = "friction.yaml"
NUMBERS_NAME = "identification.json"

_CAMPAIGN = "campaigns/friction.yaml"
_ROWS = (
    ("sliding_force", "sliding force", "N"),
    ("static_force", "force at zero speed", "N"),
    ("slope", "slope", "N s/m"),
    ("decay_velocity", "decay velocity", "m/s"),
)
_LAWS = {"coulomb": "constant", "velocity": "line", "stribeck": "with Stribeck part"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    add = parser.add_argument
    add("bag", type=Path, nargs="?", metavar="BAG", help="a recorded run; by default a new one")
    add("--motor", type=Path, metavar="FILE", help="YAML file of the motor, by default the paper's")
    add("--campaign", type=Path, metavar="FILE", help=f"the run, by default params/{_CAMPAIGN}")
    add("--frequency", type=float, metavar="HZ", help="of the sine, by default as in the campaign")
    add("--mass", type=float, metavar="KG", help="of the slider, by default as the run info tells")
    defaults = IdentificationParameters()
    add(
        "--threshold",
        type=float,
        default=defaults.threshold,
        metavar="M/S",
        help="smallest mean relative speed of a step that a law is fitted to, default %(default)s",
    )
    add(
        "--leave-out-bad-steps",
        action="store_true",
        help="go on without steps whose samples are clipped, dropped or missing",
    )
    add_run_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Identify, write the files, print the result."""
    settings = IdentificationParameters(
        threshold=options.threshold, leaves_out_bad_steps=options.leave_out_bad_steps
    )
    bag, output = _recorded(options) if options.bag else _carried_out(options)
    found = identify_bag(bag, settings, options.mass)
    files = _write(found, bag, output)
    content = {"bag": str(bag), "output": str(output), "files": files, **found.to_mapping()}
    if options.json:
        print_json(content)
    else:
        print(_text(found, files))
    if found.reason:
        print(f"error: no friction law: {found.reason}", file=sys.stderr)
    return 1 if found.reason else 0


def _recorded(options: argparse.Namespace) -> tuple[Path, Path]:
    for name in ("motor", "campaign", "frequency"):
        if getattr(options, name) is not None:
            raise BadInputError("is for a new run, not for a recorded one", where=f"--{name}")
    output = options.output
    if output is None:
        moment = datetime.now().strftime("%Y%m%d-%H%M%S")
        output = Path("results") / f"friction-{moment}"
    elif (output / NUMBERS_NAME).exists():
        raise BadInputError("holds results already", where=str(output), bound="a new folder")
    return options.bag, output


def _carried_out(options: argparse.Namespace) -> tuple[Path, Path]:
    """Carry out the run; return its bag, and the folder of the results."""
    campaign = _campaign(options)
    output = output_folder(campaign, options)
    result = carry_out(campaign, options, output)[0]
    if result.status != DONE:
        raise RunError(f"the run failed: {result.error}")
    return output / result.bag, output


def _campaign(options: argparse.Namespace) -> Campaign:
    """Return the campaign of one run, with the motor and the frequency asked for."""
    campaign = load_campaign(options.campaign or find_params(_CAMPAIGN))
    check_friction_campaign(campaign, str(options.campaign))
    named = campaign.points[0]
    point, drive = named.parameters, named.parameters.drive
    if options.frequency is not None:
        point = point.replace(drive=drive.replace(frequency=options.frequency))
    if options.motor is not None:
        motor = MotorParameters.from_mapping(read_yaml(options.motor), str(options.motor))
        point = point.replace(stand=point.stand.replace(motor=motor))
    return replace(campaign, points=(replace(named, parameters=point),))


def _write(found: Identification, bag: Path, output: Path) -> dict[str, str]:
    """Write law, numbers and pictures; return their paths by kind."""
    output.mkdir(parents=True, exist_ok=True)
    files = {"numbers": output / NUMBERS_NAME}
    text = json.dumps(found.to_mapping(), indent=1, allow_nan=False)
    files["numbers"].write_text(text + "\n", encoding="utf-8")
    if not found.reason:
        files["law"] = output / LAW_NAME
        files["law"].write_text(_law_text(found, bag), encoding="utf-8")
    files.update(draw_figures(found, bag, output))
    return {kind: str(path) for kind, path in files.items()}


def _law_text(found: Identification, bag: Path) -> str:
    """Return the law as YAML, with what it rests on as comments."""
    fit = found.fit
    used = sum(one.is_fitted for one in found.steps)
    lines = [
        f"# Friction law identified from {bag}:",
        f"# sine of {found.frequency:g} Hz, {used} of {len(found.steps)} steps, {found.mass:g} kg.",
        "# A motor file with this group alone is complete.",
        "# Intervals hold noise and misfit; calibration adds the standard uncertainty beside.",
        "friction:",
    ]
    uncertain = found.calibration.uncertainties if found.calibration else {}
    for name, value in found.friction_mapping().items():
        note = ""
        if name in fit.estimates:
            one = fit.estimates[name]
            note = (
                f"  # {one.low:.5g} to {one.high:.5g}; calibration {uncertain.get(name, 0.0):.2g}"
            )
        elif name == "break_away_force" and value == 0.0:
            note = "  # N; 0: the sliding force at zero speed"
        lines.append(f"  {name}: {value}{note}")
    return "\n".join(lines) + "\n"


def _text(found: Identification, files: dict[str, str]) -> str:
    parts = [_steps_text(found)]
    if found.fits:
        parts.append(_fits_table(found))
        parts.append(f"chosen: {found.chosen} ({_LAWS[found.chosen]})")
    parts.append(_break_away_text(found))
    if found.hysteresis:
        one = found.hysteresis
        parts.append(
            f"falling less rising branch: {format_interval(one.value, one.low, one.high, 1e3)} mN"
        )
    parts += _calibration_text(found)
    parts += [f"warning: {text}" for text in found.warnings]
    parts += [f"{kind}: {path}" for kind, path in files.items()]
    return "\n".join(parts)


def _steps_text(found: Identification) -> str:
    regimes = [one.regime for one in found.steps]
    counts = [f"{regimes.count(name)} {name}" for name in ("sticks", "both", "slides")]
    text = f"{len(regimes)} steps at {found.frequency:g} Hz: " + ", ".join(counts)
    if regimes.count(""):
        text += f", {regimes.count('')} not evaluated"
    if found.sliding_from == found.sliding_from:
        text += f"; sliding all the time from {1e3 * found.sliding_from:.3g} mm/s on"
    return text


def _fits_table(found: Identification) -> str:
    header = ["", *(_LAWS[law] for law in found.fits), "unit"]
    rows = []
    for name, title, unit in _ROWS:
        cells = []
        for fit in found.fits.values():
            one = fit.estimates.get(name)
            cells.append(format_interval(one.value, one.low, one.high) if one else "-")
        rows.append([title, *cells, unit])
    fits = found.fits.values()
    rows.append(["scatter", *(f"{1e3 * fit.scatter:.3g}" for fit in fits), "mN"])
    rows.append(["information criterion", *(f"{fit.information:.1f}" for fit in fits), ""])
    return table(rows, header)


def _break_away_text(found: Identification) -> str:
    more = found.break_away
    if more is None:
        return "break-away force: -"
    if more.force is None:
        text = f"break-away force: - ({more.reason})"
    else:
        one = more.force
        text = f"break-away force: {format_interval(one.value, one.low, one.high)} N"
    paper = found.paper_force
    if paper is not None:
        text += (
            "; by the paper's assumption, force at zero speed: "
            f"{format_interval(paper.value, paper.low, paper.high)} N"
        )
    held, slipped = more.highest_sticking, more.lowest_slipping
    if held == held:
        text += f"\nheld {held:.3g} N at least"
    if slipped == slipped:
        text += f"\nslipped at {slipped:.3g} N at most"
    return text + (f"\n{more.remark}" if more.remark else "")


def _calibration_text(found: Identification) -> list[str]:
    one = found.calibration
    if one is None:
        return []
    names = {name: title for name, title, _ in _ROWS}
    units = {name: unit for name, _, unit in _ROWS}
    parts = [f"{names[k]} ± {v:.2g} {units[k]}" for k, v in one.uncertainties.items() if k in names]
    heads = f"heads where the slider sticks: {one.head_ratio:.4f} ± {one.head_uncertainty:.1g}"
    return [f"calibration of the heads (standard uncertainty): {', '.join(parts)}", heads]
