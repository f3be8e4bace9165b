from .disturbed_model import DisturbedModel as DisturbedModel
