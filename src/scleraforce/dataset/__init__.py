"""The data set: a plan of random samples, their simulated slices, and the checked store that keeps both."""

from scleraforce.dataset.generate import Generation, generate_dataset
from scleraforce.dataset.modulus import CalibratedModulus, read_population_modulus
from scleraforce.dataset.plan import DatasetPlan, plan_dataset
from scleraforce.dataset.store import Dataset, open_dataset

__all__ = [
    "CalibratedModulus",
    "Dataset",
    "DatasetPlan",
    "Generation",
    "generate_dataset",
    "open_dataset",
    "plan_dataset",
    "read_population_modulus",
]
