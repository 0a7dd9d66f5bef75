"""Tests, their helpers and benchmarks. The folders mirror the source; check.py runs everything."""

import server as server  # first: it sets what numpy reads when it is imported
