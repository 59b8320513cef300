"""A pytest plugin that mutates one module, which the environment names, in the tests' process."""

from __future__ import annotations

import json
import os
import sys

from bench.reliability.code_mutants.operators import Site
from bench.reliability.code_mutants.running import MutatingFinder
from bench.reliability.code_mutants.survivors import VARIABLE

_module, _site = json.loads(os.environ[VARIABLE])
sys.meta_path.insert(0, MutatingFinder(_module, Site(*_site)))
