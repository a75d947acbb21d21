"""Makes `python -m imotor_ros.cli` the command line."""

import os
import sys

from imotor_ros.cli.main import main

if "--json" in sys.argv:
    # libraries that write to file descriptor 1 by themselves must not spoil the JSON
    sys.stdout.flush()
    sys.stdout = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

sys.exit(main())
