"""Timings, outside the test-suite: ``python -m benchmarks [NAME ...]``. Only medians and ratios of one run count."""
