from .plant import LinearPlant as LinearPlant
from .transfer_functions import sorted_zeros as sorted_zeros
from .transfer_functions import transfer_function as transfer_function
from .transformations import with_input_gains as with_input_gains
