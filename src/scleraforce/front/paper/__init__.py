"""The whole pipeline in stages, and the page that shows a run beside the paper."""
