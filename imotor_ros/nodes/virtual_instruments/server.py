"""The sockets of a virtual laboratory, and the faults that can be asked for; runnable."""

from __future__ import annotations

import argparse
import json
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from imotor_ros.campaign.campaign import load_campaign
from imotor_ros.campaign.point import PointParameters
from imotor_ros.errors import BadInputError, ImotorError, UnreadableFileError
from imotor_ros.nodes.virtual_instruments.generator import (
    KeysightGenerator,
    TektronixGenerator,
    WaveformGenerator,
)
from imotor_ros.nodes.virtual_instruments.laboratory import WIRES, Laboratory
from imotor_ros.nodes.virtual_instruments.oscilloscope import (
    KeysightOscilloscope,
    TektronixOscilloscope,
    VirtualOscilloscope,
)
from imotor_ros.nodes.virtual_instruments.syntax import Instrument, MessageReader

GENERATORS: Mapping[str, type[WaveformGenerator]] = {
    "keysight_33500": KeysightGenerator,
    "tektronix_afg3000": TektronixGenerator,
}
OSCILLOSCOPES: Mapping[str, type[VirtualOscilloscope]] = {
    "tektronix_mso5": TektronixOscilloscope,
    "keysight_infiniivision": KeysightOscilloscope,
}
FAULTS = (
    "identity", "error_after_upload", "no_trigger", "short_record", "cut_record", "slow",
)  # fmt: skip
"""What can go wrong on request: "fault NAME FAULT [SECONDS]" on the control socket."""


class SocketServer:
    """
    One listening socket; every connection has a thread of its own.

    Parameters
    ----------
    host, port : str, int
        Where it listens; port 0 is one that is free.
    serve : callable
        Serves a connection until its end.

    """

    def __init__(self, host: str, port: int, serve: Callable[[socket.socket], None]) -> None:
        self._serve = serve
        self._socket = socket.create_server((host, port))
        self.port = int(self._socket.getsockname()[1])
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            connection, _ = self._socket.accept()
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            threading.Thread(target=self._guard, args=(connection,), daemon=True).start()

    def _guard(self, connection: socket.socket) -> None:
        try:
            self._serve(connection)
        except OSError:
            return
        finally:
            connection.close()


def serve_instrument(instrument: Instrument, connection: socket.socket) -> None:
    """Answer what an instrument is asked, with the faults it has."""
    reader = MessageReader()
    while data := connection.recv(1 << 16):
        for text, block in reader.feed(data):
            answers = instrument.execute(text, block)
            if not answers:
                continue
            parts = [one if isinstance(one, bytes) else one.encode() for one in answers]
            answer = b";".join(parts) + b"\n"
            time.sleep(instrument.faults.get("slow", 0.0))
            if "cut_record" in instrument.faults and answer.startswith(b"#"):
                connection.sendall(answer[: len(answer) // 2])
                connection.shutdown(socket.SHUT_RDWR)
                return
            connection.sendall(answer)


class VirtualLaboratory:
    """
    Instruments on sockets around a motor, as a file describes them.

    Parameters
    ----------
    mapping : mapping
        Content of the file.
    point : PointParameters
        Motor, transducers and seed.
    host : str
        Where the sockets listen.
    is_anywhere : bool
        Whether they take any free port instead of that of the file.

    Raises
    ------
    BadInputError
        If the file does not describe a laboratory.

    """

    def __init__(
        self, mapping: Any, point: PointParameters, host: str, *, is_anywhere: bool
    ) -> None:
        self._laboratory = Laboratory(
            point.stand,
            int(mapping.get("seed", point.seed)),
            float(mapping["amplifier_gain"]),
            {wire: float(mapping["volts_per_unit"][wire]) for wire in WIRES},
        )
        self.instruments: dict[str, Instrument] = {}
        self.ports: dict[str, int] = {}
        described = mapping["generator"]
        kind = _choose(GENERATORS, described, "generator")
        self._generator = kind(self._laboratory, int(described["memory"]))
        self.instruments["generator"] = self._generator
        for number, one in enumerate(mapping["oscilloscopes"], 1):
            made = _choose(OSCILLOSCOPES, one, f"oscilloscopes: {number}")(
                self._laboratory,
                wires={int(k): str(v) for k, v in one["wires"].items()},
                bits=int(one["bits"]),
                memory=int(one["memory"]),
                gain_error=float(one["gain_error"]),
                seed=point.seed + number,
            )
            self.instruments[f"oscilloscope_{number}"] = made
        ports = [described["port"], *(one["port"] for one in mapping["oscilloscopes"])]
        for (name, instrument), port in zip(self.instruments.items(), ports, strict=True):
            serve = _server_of(instrument)
            self.ports[name] = SocketServer(host, 0 if is_anywhere else int(port), serve).port
        control = 0 if is_anywhere else int(mapping.get("control_port", 0))
        self.ports["control"] = SocketServer(host, control, self._serve_control).port

    def _serve_control(self, connection: socket.socket) -> None:
        with connection.makefile("rw", encoding="utf-8") as lines:
            for line in lines:
                lines.write(json.dumps(self.control(line.split())) + "\n")
                lines.flush()

    def control(self, words: list[str]) -> dict[str, Any]:
        """Carry out a line of the control socket: a fault, none, or just the state."""
        match words:
            case ["fault", name, fault, *rest] if name in self.instruments and fault in FAULTS:
                self.instruments[name].faults[fault] = float(rest[0]) if rest else 1.0
            case ["clear"]:
                for one in self.instruments.values():
                    one.faults.clear()
            case ["state"]:
                pass
            case _:
                return {"error": f"not understood: {' '.join(words)}"}
        return {
            "is_on": self._generator.is_on,
            "runs": self._laboratory.runs,
            "peak": self._laboratory.peak,
        }


def _server_of(instrument: Instrument) -> Callable[[socket.socket], None]:
    return lambda connection: serve_instrument(instrument, connection)


def _choose(kinds: Mapping[str, Any], described: Mapping[str, Any], where: str) -> Any:
    family = str(described.get("family"))
    if family not in kinds:
        raise BadInputError(
            "is not a family", where=f"{where}: family", value=family,
            bound="one of " + ", ".join(kinds),
        )  # fmt: skip
    return kinds[family]


def _point_of(campaign: str) -> PointParameters:
    if not campaign:
        return PointParameters()
    return load_campaign(Path(campaign)).points[0].parameters


def _read(path: Path) -> Any:
    try:
        return yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UnreadableFileError(f"cannot be read: {error}", where=str(path)) from error


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="virtual_instruments",
        description="Virtual generator and oscilloscopes on sockets, around the virtual motor.",
    )
    parser.add_argument("laboratory", type=Path, help="file below params/scpi/laboratories/")
    parser.add_argument("--campaign", default="", help="whose motor and transducers; the paper's")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen at")
    parser.add_argument("--any-port", action="store_true", help="listen at ports that are free")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Serve until SIGINT or SIGTERM; one line of JSON tells the ports."""
    options = _parser().parse_args(arguments)
    is_ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: is_ended.set())
    try:
        laboratory = VirtualLaboratory(
            _read(options.laboratory),
            _point_of(options.campaign),
            options.host,
            is_anywhere=options.any_port,
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        what = str(error) if isinstance(error, ImotorError) else f"does not describe it: {error!r}"
        sys.stderr.write(f"error: {options.laboratory}: {what}\n")
        return 2
    except OSError as error:
        sys.stderr.write(f"error: {options.laboratory}: cannot listen: {error.strerror}\n")
        return 1
    sys.stdout.write(json.dumps(laboratory.ports) + "\n")
    sys.stdout.flush()
    is_ended.wait()
    return 0


if __name__ == "__main__":
    sys.exit(main())
