"""Tests, their helpers and benchmarks. The folders mirror the source; check.py runs everything."""

import imuscope.server  # noqa: F401 - first: it sets what numpy reads when it is imported
