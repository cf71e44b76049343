"""Timings, outside the test-suite: ``python -m benchmarks [NAME ...]``. Machines are noisy: medians and ratios of one run count."""
