"""Logs written by the vendor's software."""

import pytest

from tests.support.source_files import ROOT

LOGS = ROOT.parent / "shared" / "vectors" / "isb" / "logs"


NAME = "LOG_SN60339_20261120_120000_0001"


needs_logs = pytest.mark.skipif(not LOGS.exists(), reason="the vendor's logs are not beside this project")
