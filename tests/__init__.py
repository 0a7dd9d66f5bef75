"""Tests, their helpers and benchmarks. The folders mirror the source; check.py runs everything."""
