"""The data set: a plan of random samples, their simulated slices, and the checked store that keeps both."""

from scleraforce.dataset.generate import Generation as Generation, generate_dataset as generate_dataset
from scleraforce.dataset.modulus import (
    CalibratedModulus as CalibratedModulus,
    read_population_modulus as read_population_modulus,
)
from scleraforce.dataset.plan import DatasetPlan as DatasetPlan, plan_dataset as plan_dataset
from scleraforce.dataset.store import Dataset as Dataset, open_dataset as open_dataset
