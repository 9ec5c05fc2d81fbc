"""``python -m ludus.cli``."""

import sys

from ludus.cli.main import main

sys.exit(main())
