"""The experiments: one module with the stages of a kind, one with its page.

A stage is a pure function from Datasets and frozen settings to a Dataset. Which stages a kind has,
and what each needs, stands in :mod:`pipelines.stages`.
"""
