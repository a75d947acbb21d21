"""
A recorder to be killed: writes a run block by block and says how many messages were committed.

Arguments: folder of the bag, number of blocks, samples in a block, "zstd" or "plain".
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

from imotor_ros.bag.writer import RunWriter

StandRun = runpy.run_path(str(Path(__file__).with_name("conftest.py")))["StandRun"]


def main() -> None:
    folder, blocks, size, compression = sys.argv[1:]
    run = StandRun(blocks=int(blocks), size=int(size))
    messages = run.in_order()
    writer = RunWriter(
        Path(folder),
        run_id=run.run_id,
        run_info=run.info,
        provenance={"host": "here"},
        is_compressed=compression == "zstd",
        clock=lambda: 0.0,
    )
    print("open", flush=True)
    for number, message in enumerate(messages):
        writer.write(message.topic, message.data, message.time + number)
        if number % 50 == 49:
            writer.commit()
            print(number + 1, flush=True)
    print("written", flush=True)
    sys.stdin.readline()
    writer.close("completed")
    print("closed", flush=True)


if __name__ == "__main__":
    main()
