"""Fixtures of browser tests; those of all tests are in tests/conftest.py."""

from tests.browser.failure_artifacts import pytest_runtest_makereport

__all__ = ["pytest_runtest_makereport"]
