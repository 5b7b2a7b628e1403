"""Benchmarks: accuracy against run time of every numerical part."""
