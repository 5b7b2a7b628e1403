"""Modules shared by several kinds of experiment.

- settings: :mod:`~pipelines.experiments.shared.settings`, of laser, sphere and material, and
  :mod:`~pipelines.experiments.shared.punch_settings`
- reading: :mod:`~pipelines.experiments.shared.laser_readings`,
  :mod:`~pipelines.experiments.shared.mach1_readings` with
  :mod:`~pipelines.experiments.shared.mach1_touch`,
  :mod:`~pipelines.experiments.shared.ramps_and_holds`,
  :mod:`~pipelines.experiments.shared.film_frames`
- models: :mod:`~pipelines.experiments.shared.material_choice`,
  :mod:`~pipelines.experiments.shared.plate_under_drop`,
  :mod:`~pipelines.experiments.shared.punch_model`
- results handed on by name: :mod:`~pipelines.experiments.shared.given`
- pages: :mod:`~pipelines.experiments.shared.reports`, the page of a kind as a list of sections,
  :mod:`~pipelines.experiments.shared.pages`, sections of every report,
  :mod:`~pipelines.experiments.shared.budget_blocks`,
  :mod:`~pipelines.experiments.shared.punch_sections`
- what becomes of results: :mod:`~pipelines.experiments.shared.budget_quantity`,
  :mod:`~pipelines.experiments.shared.material_evidence`,
  :mod:`~pipelines.experiments.shared.drop_evidence`,
  :mod:`~pipelines.experiments.shared.punch_evidence`
"""
