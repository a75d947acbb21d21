"""Makes `python -m imotor_ros.cli` the command line."""

import sys

from imotor_ros.cli.main import main

sys.exit(main())
