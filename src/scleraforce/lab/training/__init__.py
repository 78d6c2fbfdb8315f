"""Training: it makes the model folders that `reading` loads.

The only package that imports PyTorch (extra `train`). Imports `lab`, `lab.scenes`,
`calibration` and the rows below it.

Public:
    classifier_training: `grid`
    reader_samples: `draw_samples`
    slice_dataset: `Dataset`, `generate_dataset`, `open_dataset`
    trained_models: `train_classifier`, `train_raw_reader`, `train_reader`,
        `train_wall_finder`
"""
