"""``python -m ludus``."""

import sys

from ludus.cli.main import main

sys.exit(main())
