"""The whole pipeline in stages, and the page that shows a run beside the paper.

Imports `front.report` and every package below `front`.

Public:
    demo: `SETUP`, `run_demo`
    run_folder: `Progress`, `framed_for_laboratory`, `open_run`
    stages: `reproduce`
"""
