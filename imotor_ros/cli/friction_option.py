"""The option `--friction`: a law by its name, or a file that says what it is."""

from __future__ import annotations

from pathlib import Path
from typing import cast

from imotor_ros.campaign.campaign import read_yaml
from imotor_ros.core.friction import FRICTION_LAWS, FrictionLaw
from imotor_ros.core.motor import MotorParameters
from imotor_ros.errors import BadInputError

FRICTION_HELP = (
    f"friction law: {', '.join(FRICTION_LAWS)} with the values of the paper, or the YAML file of a "
    "motor or of an identified law"
)


def friction_law(text: str) -> FrictionLaw:
    """
    Return the friction law that an option names.

    Parameters
    ----------
    text : str
        Name of a law, or path of a YAML file with the group `friction`, as `identify-friction`
        leaves it and as motor files have it.

    Raises
    ------
    BadInputError
        If it is neither, or the file says nothing of the friction.
    UnreadableFileError
        If the file does not parse.

    """
    if text in FRICTION_LAWS:
        return cast("FrictionLaw", FRICTION_LAWS[text]())
    path = Path(text)
    if not path.is_file():
        raise BadInputError(
            "is neither a law nor a file", where="--friction", value=text,
            bound=f"one of {', '.join(FRICTION_LAWS)}, or a YAML file",
        )  # fmt: skip
    content = read_yaml(path)
    motor = MotorParameters.from_mapping(content, text)
    if "friction" not in content:
        raise BadInputError("is missing", where=f"{text}: friction", bound="a group with a law")
    return cast("FrictionLaw", motor.friction)
