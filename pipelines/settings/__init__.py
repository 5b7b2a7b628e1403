"""Part of pipelines."""
