"""``python -m camgen``."""

from camgen.cli import run

run()
